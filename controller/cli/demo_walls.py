"""Runs the walls of ``haptic-wall demo``: two simulated servos, one guarded, and one page.

Each servo is a run as ``haptic-wall run`` makes it. The unguarded one has the same code and the
same guard, but believes that the servo has so much friction that nothing is limited: without a
guard, `guard.mode` at off, an oscillation ends a run.

One process serves both runs: over a socket each supervisor sends it what the process of a live page
inherits. Two live pages in one browser page would be two origins, which the server refuses. A proxy
in front of them would unpack each row twice. Two loops in one process, or a simulation in
JavaScript, would not show this program.
"""

from __future__ import annotations

import json
import os
import shutil
import signal
import socket
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import asdict
from pathlib import Path
from typing import Final

from haptic_wall.controller.cli.started import RunningWall
from haptic_wall.controller.errors import PlatformError
from haptic_wall.controller.live.place import Live
from haptic_wall.controller.processes.children import Child
from haptic_wall.controller.runtime.realtime import pick_cores

MODULE: Final = "haptic_wall.controller.live.lesson_process"
RUN_S: Final = 900.0
"""Time after which a run is started anew, so that its log does not fill the disk [s]"""
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
    "wall.stiffness=2.5",
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
_END_S: Final = 2.0
_PAUSE_S: Final = 0.1
_LEAST_S: Final = 2.0
"""A run that ended sooner is not started anew [s]"""


class Demo:
    """The two walls and the page, as long as ``demo`` lasts.

    Args:
        live: The page's place.
        folder: For the runs' logs.
        scope: Ends what is started.
        over: Whether the demo ends.
    """

    def __init__(
        self, live: Live, folder: Path, scope: ExitStack, over: Callable[[], bool]
    ) -> None:
        self._folder = folder
        self._ours: dict[str, socket.socket] = {}
        self._walls: dict[str, tuple[RunningWall, float]] = {}
        theirs = {}
        for name in SERVOS:
            ours, their = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
            self._ours[name] = scope.enter_context(ours)
            theirs[name] = scope.enter_context(their)
        descriptors = {name: each.fileno() for name, each in theirs.items()}
        orders = {"parent": os.getpid(), "live": asdict(live), "servos": descriptors}
        orders |= {"log": str(folder / "page.txt")}
        inherited = [live.descriptor, *descriptors.values()]
        self.page = Child("page", [MODULE], orders, inherited, pick_cores()[1])
        scope.callback(self.page.dismiss, _END_S)
        scope.callback(self.close)
        for each in theirs.values():
            each.close()
        for name in SERVOS:
            self._start(name)
        for wall, _ in self._walls.values():
            wall.await_start(over)
            if not wall.running():
                wall.wait()

    def _start(self, name: str) -> None:
        """Start a servo's run; its last log is removed."""
        place = self._folder / name
        shutil.rmtree(place, ignore_errors=True)
        place.mkdir()
        log, page = place / "run.hwlog", self._ours[name].fileno()
        arguments = ["run", "simulated", "--json", "--no-plot", "--log", str(log)]
        arguments += ["--duration", f"{RUN_S:g}", "--page-socket", str(page)]
        for change in (*SERVO, *SERVOS[name]):
            arguments += ["--set", change]
        self._walls[name] = RunningWall(log, arguments, [page], quiet=True), time.monotonic()

    def look(self) -> None:
        """Start a run anew that has ended.

        Raises:
            HapticWallError: A run, or the page, ends at once again.
        """
        if self.page.ended():
            troubles = [json.loads(line)["trouble"] for line in self.page.lines()]
            raise PlatformError(
                f"the page's process {self.page.exit_text()} {'; '.join(troubles)}".rstrip(),
                advice="start the demo again",
            )
        for name, (wall, began_s) in self._walls.items():
            if wall.running():
                continue
            report = wall.wait()
            if time.monotonic() < began_s + _LEAST_S:
                raise PlatformError(
                    f"the {name} servo's run ended at once: {report['stop_reason']}",
                    advice="start the demo again",
                )
            wall.close()
            self._start(name)

    def close(self) -> None:
        """End the page, which says so to its clients, and then the runs, together."""
        self.page.send(signal.SIGTERM)
        self.page.wait(_END_S)
        for wall, _ in self._walls.values():
            wall.end()
        for wall, _ in self._walls.values():
            with suppress(OSError):
                wall.close()


@contextmanager
def demo(live: Live, over: Callable[[], bool]) -> Iterator[Demo]:
    """Run two walls and their page; all of it ends with the block.

    Args:
        live: The page's place.
        over: Whether the demo ends; then the start is not waited for.
    """
    with ExitStack() as scope:
        folder = scope.enter_context(tempfile.TemporaryDirectory(prefix="haptic-wall-demo-"))
        yield Demo(live, Path(folder), scope, over)


def serve(running: Demo, over: Callable[[], bool]) -> None:
    """Watch a demo until ``over``."""
    while not over():
        running.look()
        time.sleep(_PAUSE_S)
