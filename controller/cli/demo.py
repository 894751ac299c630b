"""``haptic-wall demo``: a lesson in the browser, over the live pages of two simulated servos.

Each servo is a run as ``haptic-wall run --live`` makes it. The unguarded one has the same code and
the same guard, but believes that the servo has so much friction that nothing is limited: without a
guard, ``guard.mode`` at off, an oscillation ends a run.
"""

from __future__ import annotations

import os
import re
import tempfile
import time
from collections.abc import Callable
from contextlib import ExitStack
from pathlib import Path
from typing import Final
from urllib.parse import quote

import click

from haptic_wall.controller.cli import interrupt
from haptic_wall.controller.cli.options import place_option, put
from haptic_wall.controller.errors import PlatformError
from haptic_wall.controller.live.place import live_at

RUN_S: Final = 1800.0
"""Time after which the demo ends, so that its logs do not fill the disk [s]"""
SERVO: Final = (
    "servo.inertia=6e-4",
    "servo.damping=0.003",
    "servo.coulomb=0.004",
    "servo.delay=0.002",
    "servo.counts_per_rev=65536",
    "servo.torque_limit=0.5",
    "servo.torque_step=0",
    # A weight presses it into the wall, by half of what the wall can hold.
    "servo.gravity=0.25",
    "servo.gravity_angle=1.5708",
    "servo.hand=none",
    "servo.kick=-0.02",
    "wall.stiffness=2.64",
    "wall.damping=0.02",
    "safety.max_speed=1000",
)
"""Both servos: a light one whose torque acts 2 ms late"""
SERVOS: Final = {
    "free": (
        "model.inertia=10",
        "model.damping=10",
        "model.delay=0",
        "safety.on_oscillation=report",
    ),
    "guarded": (),
}
"""What differs between the two, by the name that the page gives them"""
_PAUSE_S: Final = 0.1
_ADDRESS: Final = re.compile(r"^live: (http:\S+)$", re.MULTILINE)


@click.command()
@place_option
def command(place: str) -> int:
    """Show in a browser why a stiff wall oscillates, and how the guard prevents it.

    The address is the first line on standard output; Ctrl-C ends the demo. The page has two
    simulated servos, one with the guard and one without. A mouse or a finger drags each of them. No
    hardware is needed.
    """
    live = live_at(place, field="--at")
    os.close(live.descriptor)  # the first run listens there
    with interrupt.until_signal() as came, ExitStack() as scope:
        _show(live.address, scope, lambda: bool(came))
    return interrupt.status_after(came)


def _show(address: str, scope: ExitStack, over: Callable[[], bool]) -> None:
    """Run two walls until ``over``, and print the address of their page.

    Args:
        address: Where the first of them listens.
        scope: Ends what is started.
        over: Whether the demo ends.

    Raises:
        HapticWallError: A run could not start, or has ended.
    """
    from haptic_wall.controller.cli.started import RunningWall

    folder = Path(scope.enter_context(tempfile.TemporaryDirectory(prefix="haptic-wall-demo-")))
    host, _, port = address.removeprefix("http://").rstrip("/").rpartition(":")
    walls: dict[str, RunningWall] = {}
    for name, where in zip(SERVOS, (f"{host}:{port}", f"{host}:0"), strict=True):
        log = folder / name / "run.hwlog"
        log.parent.mkdir()
        arguments = ["run", "simulated", "--json", "--no-plot", "--log", str(log)]
        arguments += ["--duration", f"{RUN_S:g}", "--live", where, "--live-control"]
        for change in (*SERVO, *SERVOS[name]):
            arguments += ["--set", change]
        told = scope.enter_context((folder / f"{name}.txt").open("w"))
        walls[name] = RunningWall(log, arguments, said=told)
        scope.callback(walls[name].close)
    shown = False
    while not over():
        for name, wall in walls.items():
            if not wall.running():
                raise PlatformError(
                    f"the {name} servo's run has ended: {wall.wait()['stop_reason']}",
                    advice="start the demo again",
                )
        found = [_ADDRESS.search((folder / f"{name}.txt").read_text()) for name in walls]
        first, second = (each and each[1] for each in found)
        if first and second and not shown:
            put(f"{first.replace('/?', '/lesson.html?')}#{quote(second, safe='')}")
            shown = True
        time.sleep(_PAUSE_S)
    for wall in walls.values():
        wall.end()
