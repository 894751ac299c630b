"""Films the live page for the README.

``python -m scripts.live_gif``: a hand drags the shaft into the wall, the wall gets stiffer, and the
guard clamps it. ``python -m scripts.live_gif arm``: hands push six joints into their stops, the
page shows one after another, and a servo loses its cable.
"""

from __future__ import annotations

import io
import math
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Final

from PIL import Image

from tests.support.chromium import Tab, chromium

ROOT: Final = Path(__file__).parents[1]
SIZE: Final = (1120, 700)
SHOWN: Final = (752, 470)
FRAMES: Final = 34
FRAME_S: Final = 0.2
COLOURS: Final = 32
STIFFER_AT: Final = 14
"""Frame in which the stiffness is asked for"""
STIFFNESS: Final = 120


UNPLUGGED_S: Final = 14
"""Time from the bus's start until a servo of the arm loses its cable [s]"""
WALL: Final = ["simulated", "--set", "servo.hand=none"]
ARM: Final = [
    *("emulated-arm", "--set", "loop.clock=monotonic"),
    *("--set", f"servo.faults=unplug:id=5,at={UNPLUGGED_S}"),
]


def film_arm(tab: Tab) -> list[Image.Image]:
    """Return pictures of the page of an arm, until its run is over."""
    pictures, begin = [], time.monotonic()
    for k in range(2 * FRAMES):
        if k % 12 == 6:
            number = k // 12 % 6
            tab.value(f"document.querySelectorAll('#strip .axis')[{number}].click()")
        pictures.append(_picture(tab))
        if tab.value("document.getElementById('state').textContent.includes('over')"):
            return [*pictures, *[_picture(tab)] * 10]
        time.sleep(max(0.0, begin + (k + 1) * FRAME_S - time.monotonic()))
    return pictures


def _picture(tab: Tab) -> Image.Image:
    shot = Image.open(io.BytesIO(tab.shot())).convert("RGB").resize(SHOWN)
    return shot.quantize(COLOURS, dither=Image.Dither.NONE)


def film(tab: Tab) -> list[Image.Image]:
    """Return pictures of the page, at even times."""
    box = tab.value(
        "(() => { const { x, y, width, height } ="
        " document.getElementById('hand').getBoundingClientRect();"
        " return { x, y, width, height }; })()"
    )
    pictures = []
    pressed = False
    begin = time.monotonic()
    for k in range(FRAMES):
        x = box["x"] + box["width"] * (0.55 - 0.2 * math.cos(0.45 * k))
        y = box["y"] + 0.5 * box["height"]
        tab.mouse("mouseMoved" if pressed else "mousePressed", x, y)
        pressed = True
        if k == STIFFER_AT:
            tab.value(
                "(() => { const field = document.querySelector('.knob input[type=number]');"
                f" field.value = {STIFFNESS}; field.dispatchEvent(new Event('change')); }})()"
            )
        pictures.append(_picture(tab))
        time.sleep(max(0.0, begin + (k + 1) * FRAME_S - time.monotonic()))
    return pictures


def main() -> None:
    """Run a wall, film its page, write the file."""
    arm = sys.argv[1:] == ["arm"]
    path = ROOT / "docs" / "pictures" / ("arm.gif" if arm else "live.gif")
    with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as folder:
        run = subprocess.Popen(
            [
                *[sys.executable, "-m", "haptic_wall.controller.cli.main", "run"],
                *(ARM if arm else WALL),
                *["--live", "--live-control", "--duration", "inf", "--no-plot"],
                *["--log", f"{folder}/run.hwlog"],
            ],
            stdout=subprocess.DEVNULL,
            stderr=subprocess.PIPE,
            text=True,
        )
        try:
            assert run.stderr is not None
            address = next(line for line in run.stderr if line.startswith("live: "))[6:].strip()
            with chromium(Path(folder) / "browser") as tab:
                tab.look(*SIZE)
                tab.open(address)
                tab.wait("document.querySelector('#plane canvas') !== null")
                tab.wait("document.querySelectorAll('#marks li.wall').length > 0")
                first, *more = film_arm(tab) if arm else film(tab)
        finally:
            run.send_signal(signal.SIGINT)
            run.communicate()
    first.save(
        path,
        save_all=True,
        append_images=more,
        duration=round(1000 * FRAME_S),
        loop=0,
        optimize=True,
    )
    print(f"{path}: {path.stat().st_size / 1e6:.2f} MB")


if __name__ == "__main__":
    main()
