"""The live page in a headless Chromium: it shows what the run does."""

from __future__ import annotations

import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from haptic_wall.controller.logs.file import read_log
from tests.support.chromium import Tab

pytestmark = [pytest.mark.realtime, pytest.mark.xdist_group("browser")]
STATE = "document.getElementById('state').textContent"
SHOWN = f"{STATE}.includes(' s · K')"


@contextmanager
def program(*arguments: str) -> Iterator[tuple[subprocess.Popen[str], str]]:
    """A command of ours, and the address that it prints."""
    command = [sys.executable, "-m", "haptic_wall.controller.cli.main", *arguments]
    child = subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, process_group=0
    )
    try:
        assert child.stdout is not None
        for line in child.stdout:
            if "http://" in line:
                yield child, line[line.index("http://") :].strip()
                break
    finally:
        child.send_signal(signal.SIGINT)
        child.communicate(timeout=30.0)


@contextmanager
def running(folder: Path, *more: str) -> Iterator[str]:
    """A wall that is pushed, and the address of its page."""
    run = ["run", "simulated", "--no-plot", "--log", str(folder / "a.hwlog"), "--duration", "120"]
    with program(*run, "--set", "servo.hand=push", "--live", *more) as (_, address):
        yield address


def recorded(folder: Path) -> Path:
    """The log of a run of 3 s."""
    log = folder / "b.hwlog"
    run = ["run", "simulated", "--no-plot", "--log", str(log), "--set", "loop.clock=simulated"]
    command = [sys.executable, "-m", "haptic_wall.controller.cli.main", *run, "--duration", "3"]
    subprocess.run(command, check=True, capture_output=True)
    return log


def place(tab: Tab, selector: str) -> dict[str, float]:
    """Where an element is on the screen, as soon as it is there."""
    found: dict[str, float] = tab.wait(
        f"(() => {{ const {{ x, y, width, height }} = document.querySelector('{selector}')"
        ".getBoundingClientRect(); return width && { x, y, width, height }; })()"
    )
    return found


def press(tab: Tab, x: float, y: float) -> None:
    """Click there."""
    tab.mouse("mouseMoved", x, y, buttons=0)
    tab.mouse("mousePressed", x, y)
    tab.mouse("mouseReleased", x, y)


def downloaded(path: Path) -> bytes:
    """The content of a file that the browser is about to save."""
    end_s = time.monotonic() + 15.0
    while not path.exists() or not path.stat().st_size:
        assert time.monotonic() < end_s, list(path.parent.iterdir())
        time.sleep(0.02)
    return path.read_bytes()


def ask(tab: Tab, path: str, value: float) -> None:
    """Turn a knob by its number."""
    tab.value(
        f"(() => {{ const field = document.getElementById('{path}').nextElementSibling;"
        f" field.value = {value}; field.dispatchEvent(new Event('change')); }})()"
    )


def test_the_curve_moves_and_the_page_complains_of_nothing(tab: Tab, tmp_path: Path) -> None:
    with running(tmp_path) as address:
        tab.open(address)
        tab.wait(SHOWN)
        seconds = "parseFloat(document.getElementById('state').textContent)"
        before = tab.value(seconds)
        drawn = "document.querySelector('#panels canvas').toDataURL()"
        first = tab.value(drawn)
        tab.wait(f"{seconds} > {before} + 0.5")
        assert tab.value(drawn) != first
        tab.wait("document.querySelectorAll('#marks li.wall').length > 0")
        tab.value("document.getElementById('pause').click()")
        tab.wait("document.getElementById('pause').textContent === 'Continue'")
        held = tab.value("document.getElementById('panels').dataset.to")
        tab.wait(f"{seconds} > {before} + 1.0")
        assert tab.value("document.getElementById('panels').dataset.to") == held
    tab.wait(f"{STATE}.includes('the run is over: interrupted')")
    assert tab.value("document.getElementById('marks').innerText").strip()


def test_a_recorded_run_is_shown_as_a_whole(tab: Tab, tmp_path: Path) -> None:
    with program("live", str(recorded(tmp_path))) as (_, address):
        tab.open(address)
        tab.wait(f"{STATE}.includes('the run ended: duration · 3.00 s')")
        found = tab.value(
            "import('./exports.js').then(() => 1) && document.getElementById('name').textContent"
        )
        assert found == "simulated (recorded)"


def test_what_is_seen_is_exported_and_measured_from_a_pin(tab: Tab, tmp_path: Path) -> None:
    """The files are downloads of the browser; the rows are those of the log."""
    log = recorded(tmp_path)
    tab.call("Browser.setDownloadBehavior", behavior="allow", downloadPath=str(tmp_path))
    with program("live", str(log)) as (_, address):
        tab.open(address)
        tab.wait(f"{STATE}.includes('the run ended: duration')")
        box = place(tab, ".u-over")
        low, high = box["x"] + 0.25 * box["width"], box["x"] + 0.5 * box["width"]
        y = box["y"] + 0.5 * box["height"]
        press(tab, low, y)
        tab.mouse("mouseMoved", high, y, buttons=0)
        words = tab.wait(
            "(() => { const text = document.getElementById('readout').textContent;"
            " return text.startsWith('from the pin') && text; })()"
        )
        assert float(words.split("Δt ")[1].split()[0]) == pytest.approx(750.0, abs=10.0)
        tab.value("document.getElementById('csv').click()")
        lines = downloaded(tmp_path / "simulated.csv").decode().splitlines()
        tab.value("document.getElementById('png').click()")
        png = downloaded(tmp_path / "simulated.png")
        width = tab.value("document.querySelector('#panels canvas').width")
    assert png.startswith(b"\x89PNG")
    assert int.from_bytes(png[16:20], "big") == width
    _, rows = read_log(log)
    head, *values = [line.split(",") for line in lines]
    assert len(values) == pytest.approx(len(rows), abs=2)
    position = [float(value[head.index("position_rad")]) for value in values]
    assert position == pytest.approx(rows["position"][: len(position)], abs=1e-6)


def test_nothing_sticks_out(tab: Tab, tmp_path: Path) -> None:
    with running(tmp_path) as address:
        for width, height, dark in ((1280, 860, False), (1280, 860, True), (390, 844, False)):
            tab.look(width, height, dark=dark, phone=width < 500)
            tab.open(address)
            tab.wait(SHOWN)
            assert tab.value("document.documentElement.scrollWidth <= innerWidth")


def test_a_knob_raises_the_stiffness_to_the_clamp_and_says_why(tab: Tab, tmp_path: Path) -> None:
    with running(tmp_path, "--live-control") as address:
        tab.open(address)
        tab.wait(SHOWN)
        tab.wait("document.querySelector('#plane canvas') !== null")
        words = "not applied"
        for _ in range(3):  # a busy machine may find no moment that suits
            if "not applied" in words:
                ask(tab, "wall.stiffness", 5000)
                words = tab.wait(
                    "(() => { const text = document.querySelector('.knob .words').textContent;"
                    " return ['the guard commands', 'not applied']"
                    ".some((each) => text.includes(each)) && text; })()",
                    40.0,
                )
        assert "the guard commands" in words and "5000" in words
        tab.wait("document.getElementById('reasons').textContent.includes('5000')")
        tab.wait(
            "[...document.querySelectorAll('#marks li.change')].some((mark) => "
            "mark.innerText.includes('wall.stiffness=5000'))"
        )


def test_an_alarm_appears_and_what_was_done(tab: Tab, tmp_path: Path) -> None:
    """The servo is later than the guard believes, so that the wall swings; it is made softer."""
    sets = ["servo.delay=0.006", "model.delay=0.001", "servo.coulomb=0", "servo.hand=none"]
    sets += ["servo.kick=0.3", "wall.side=both", "wall.damping=0", "wall.stiffness=20"]
    with running(tmp_path, *(word for each in sets for word in ("--set", each))) as address:
        tab.open(address)
        words = tab.wait("document.querySelector('#marks li.alarm span')?.textContent")
        assert words.startswith("oscillation: ")
        softer = tab.wait("document.querySelector('#marks li.reduction span')?.textContent")
        before, after = (
            float(each.split()[0]) for each in softer[len("stiffness ") :].split(" → ")
        )
        assert after < before <= 20.0


def test_the_wall_is_on_while_the_button_is_held(tab: Tab, tmp_path: Path) -> None:
    more = ["--live-control", "--hold", "page", "--set", "servo.hand=none"]
    with running(tmp_path, *more) as address:
        tab.open(address)
        tab.wait(SHOWN)
        box = place(tab, "#hold")
        middle = box["x"] + 0.5 * box["width"], box["y"] + 0.5 * box["height"]
        newest = "document.querySelector('#marks li.wall')?.innerText ?? ''"
        assert tab.value(newest) == ""
        tab.mouse("mousePressed", *middle)
        tab.wait(f"({newest}).includes('is on')")
        tab.mouse("mouseReleased", *middle)
        tab.wait(f"({newest}).includes('is off')")


def test_without_the_token_the_knobs_are_fixed(tab: Tab, tmp_path: Path) -> None:
    with running(tmp_path, "--live-control") as address:
        tab.open(address.partition("?")[0])
        tab.wait(SHOWN)
        assert tab.value("[...document.querySelectorAll('#rows input')].every((i) => i.disabled)")


def test_a_hand_drags_the_shaft_into_the_wall_and_lets_go(tab: Tab, tmp_path: Path) -> None:
    with running(tmp_path, "--live-control", "--set", "servo.hand=none") as address:
        tab.open(address)
        tab.wait(SHOWN)
        box = place(tab, "#hand")
        tab.wait("document.querySelectorAll('#marks li.wall').length > 0")
        position = "parseFloat(document.querySelector('.label b').textContent)"
        begin = box["x"] + 0.45 * box["width"], box["y"] + 0.5 * box["height"]
        tab.mouse("mousePressed", *begin)
        tab.mouse("mouseMoved", box["x"] + 0.9 * box["width"], begin[1])
        tab.wait(f"{position} > 0.02")
        tab.mouse("mouseReleased", box["x"] + 0.9 * box["width"], begin[1])
        tab.wait(f"{position} < 0.05")
