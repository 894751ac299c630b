"""The process of the page of ``haptic-wall demo``: serves two running walls to browsers.

Each servo is a run of its own. Its supervisor sends what the process of a live page would inherit,
and again whenever the run was started anew. The page keeps its priority, unlike that of a live
page: it drives nothing real, and the lesson is the page.
"""

from __future__ import annotations

import asyncio
import os
import signal
import socket
import time
from collections.abc import Callable, Coroutine
from contextlib import suppress
from pathlib import Path
from typing import Any, Final

import numpy as np
from websockets.asyncio.server import ServerConnection
from websockets.http11 import Request, Response

from haptic_wall.controller.errors import HapticWallError
from haptic_wall.controller.live.client import Client
from haptic_wall.controller.live.gate import judged, servo_of
from haptic_wall.controller.live.lesson import facts, own_servo, scenes
from haptic_wall.controller.live.place import Live, take_over
from haptic_wall.controller.live.relay import ask, sets_of
from haptic_wall.controller.live.rhythm import STRETCH_S, rhythm
from haptic_wall.controller.live.running_view import view_of
from haptic_wall.controller.live.server import LiveServer
from haptic_wall.controller.live.view import View
from haptic_wall.controller.live.web_server import closed, log_to, opened
from haptic_wall.controller.runtime.idle_window import until_idle_window
from haptic_wall.controller.runtime.realtime import die_with_parent
from haptic_wall.controller.runtime.telemetry import CAPACITY, Telemetry, Word
from haptic_wall.controller.settings.config import Config
from haptic_wall.controller.settings.model import Model
from haptic_wall.controller.system.orders import read_orders, say
from haptic_wall.controller.system.signals import ended_by

FOLDERS: Final = ("page", "lesson")
"""Those with the page's files"""
REPORT_S: Final = 0.25
"""Time between two measurements [s]"""
FIRST: Final = "soft"
"""The scene with which a run begins"""
SAME_DELAY: Final = 0.01
"""Relative change of the delay that is not told, so that the text can be read [1]"""
LIFT_RAD: Final = 0.08
"""How far from the wall the weight is lifted [rad]"""
AWAY_RAD: Final = 1.2
"""Distance from the wall beyond which a weight is brought back: a stalled machine threw it [rad]"""
LIFT_S: Final = 0.5
"""Shortest time for which it is lifted [s]"""
RAISED_S: Final = 0.3
"""Time for which the full wall is waited for, once the weight is lifted [s]"""
LONGEST_S: Final = 30.0
"""Longest time for which it is lifted [s]: a run that has just begun takes its first change late"""
REFUSED: Final = 2
"""Exit status of a change that is refused whenever it is asked for"""
_GRIP: Final = 20.0
"""Stiffness of the hand that lifts it [N·m/rad]"""
_HAND_S: Final = 0.05
_LOOK_S: Final = 0.05
_SHAKES: Final = 0.1
"""Of the torque limit: a smaller range of the torque is no oscillation [1]"""


def as_it_is(config: Config, delay: float) -> tuple[Config, float]:
    """Return a configuration that believes the simulated servo to be as it is, and its delay [s].

    Args:
        config: In force.
        delay: The total delay by its belief [s]; while it is measured still, less than believed.
    """
    true = config.model_copy(update={"model": Model()})
    return true, max(delay - config.belief().delay.high, 0.0) + true.belief().delay.high


class Stage:
    """One servo: its present run, and what the lesson does with it.

    Args:
        line: Socket on which the orders of its runs come.
        live: The page.
        over: Whether the page ends.
    """

    def __init__(self, line: socket.socket, live: Live, over: Callable[[], bool]) -> None:
        self._line = line
        self._live = live
        self._over = over
        self.server: LiveServer | None = None
        """Of the present run; None: there is none"""
        self._run = Path()
        self._words: memoryview[int] | None = None
        self._moves: asyncio.Task[None] | None = None
        self._scenes: dict[str, dict[str, float]] = {}
        self._scene = ""

    async def serve(self) -> None:
        """Serve one run after the other, until the page ends."""
        while not self._over():
            try:
                orders = take_over(self._line)
            except (EOFError, OSError):
                return
            if orders is None:
                await asyncio.sleep(_LOOK_S)
            else:
                await self._serve_run(orders)

    async def _serve_run(self, orders: dict[str, Any]) -> None:
        view, news, telemetry = view_of(orders)
        view.judged_as = as_it_is
        self._words = telemetry.words
        self._run, self._scene = Path(orders["run"]), ""
        self.server = server = LiveServer(
            view,
            self._live.host,
            self._live.token,
            self._run,
            lambda wanted_s: until_idle_window(telemetry.words, view.config.period_ns, wanted_s),
            lambda client, request: self._take(view, client, request),
        )

        def until() -> bool:
            news.take()
            if reports.done():
                reports.result()
            if self._over():
                view.tell({"kind": "over"})
            return self._over() or news.over

        reports = asyncio.create_task(self._report(view, telemetry))
        try:
            await server.pump(until)
        finally:
            self.server = None
            reports.cancel()
            if self._moves is not None:
                self._moves.cancel()
            server.abort()
            news.close()
            for descriptor in (orders["telemetry"], orders["hand"]):
                if descriptor is not None:
                    os.close(descriptor)  # what is mapped stays until nobody uses it

    async def attend(self, connection: ServerConnection) -> None:
        """Serve a client of the present run."""
        if self.server is None:
            await connection.close(1013, "this servo is about to start")
        else:
            await self.server.attend(connection)

    async def _report(self, view: View, telemetry: Telemetry) -> None:
        """Tell the pages what theory says of the wall, and what is measured."""
        told: dict[str, Any] = {}
        told_of: tuple[Config, float] | None = None
        while True:
            await asyncio.sleep(REPORT_S)
            if not view.delay >= 0.0:
                continue
            config, delay = as_it_is(view.config, round(view.delay, 5))
            if (
                told_of is None
                or told_of[0] != config
                or abs(delay - told_of[1]) > SAME_DELAY * delay
            ):
                told_of = config, delay
                with suppress(ValueError, HapticWallError):  # a wall whose limits are not known
                    told = await asyncio.to_thread(facts, config, delay)
                    # By its own lag alone, so that both servos get the same walls.
                    self._scenes = self._scenes or scenes(config, config.belief().delay.high)
            if self._scenes and not self._scene:
                self._begin(view, FIRST)  # without a hand the weight would keep the wall off
            elif abs(view.shaft - config.wall.position) > AWAY_RAD and self._rests:
                self._move(self._play(view, None))
            view.tell(
                {
                    "kind": "lesson",
                    "facts": told,
                    "scene": self._scene,
                    "scenes": self._scenes,
                    **measured(telemetry, config),
                }
            )

    def _take(self, view: View, client: Client, request: dict[str, Any]) -> bool:
        """Take a request of the lesson.

        It is ``{"scene": NAME}``, ``{"drop": true}``, or ``{"own": {NAME: VALUE}}``.
        """
        if isinstance(request.get("own"), dict):
            client.tell({"kind": "own", **own_servo(request["own"])})
            return True
        if request.get("drop") is True:
            self._move(self._play(view, None))
            return True
        scene = request.get("scene")
        if not isinstance(scene, str) or scene not in self._scenes:
            return False
        self._begin(view, scene)
        return True

    @property
    def _rests(self) -> bool:
        """Return whether the lesson leaves the weight alone."""
        return self._moves is None or self._moves.done()

    def _begin(self, view: View, scene: str) -> None:
        """Show a scene; the one before ends."""
        self._scene = scene
        self._move(self._play(view, sets_of(self._scenes[scene])))

    def _move(self, move: Coroutine[Any, Any, None]) -> None:
        """Move the weight; the move before ends."""
        if self._moves is not None:
            self._moves.cancel()
        self._moves = asyncio.create_task(move)

    async def _play(self, view: View, sets: list[str] | None) -> None:
        """Lift the weight off the wall, change the wall there, and let the weight fall on it.

        Args:
            view: Of the run.
            sets: The change as ``PATH=VALUE``; None: none.
        """
        changes = asyncio.create_task(self._change(sets))
        begin = time.monotonic()
        lifted = {"position": view.config.wall.position - LIFT_RAD, "stiffness": _GRIP}
        try:
            while (waited_s := time.monotonic() - begin) < LONGEST_S:
                if waited_s >= LIFT_S and changes.done():
                    break
                view.grasp(self, lifted)
                await asyncio.sleep(_HAND_S)
        finally:
            changes.cancel()
            view.grasp(self, None)

    async def _change(self, sets: list[str] | None) -> None:
        """Ask for the full wall again, if an alarm has made it softer, and then for a change.

        A change that the run cannot take yet is asked for again; one that it refuses is not.
        """
        if self._words is not None:
            self._words[Word.RAISE] += 1
        await asyncio.sleep(RAISED_S)
        answers: list[dict[str, Any]] = []
        while sets is not None:
            await ask(self._run, sets, answers.append)
            last = answers[-1] if answers else {}
            if last.get("applied") or last.get("exit_status") == REFUSED:
                return
            answers.clear()
            await asyncio.sleep(RAISED_S)


def measured(telemetry: Telemetry, config: Config) -> dict[str, Any]:
    """Return the measured oscillation of a run.

    Returns:
        ``measured_hz``, null without a regular oscillation; ``torque_range`` [N·m] and
        ``position_range`` [rad] of the last second, from the least to the largest value.
    """
    count = round(STRETCH_S * config.loop.rate_hz)
    head = int(telemetry.words[Word.HEAD])
    rows, _ = telemetry.read(max(0, head - min(count, CAPACITY)), count)
    torque = rows["torque"][np.isfinite(rows["torque"])]
    position = rows["position"][np.isfinite(rows["position"])]
    if not len(torque) or not len(position):
        return {"measured_hz": None, "torque_range": 0.0, "position_range": 0.0}
    least = _SHAKES * (config.true_servo().torque_limit or 1.0)
    return {
        "measured_hz": rhythm(torque, config.loop.rate_hz, least),
        "torque_range": float(torque.max() - torque.min()),
        "position_range": float(position.max() - position.min()),
    }


async def serve_lesson(stages: dict[str, Stage], live: Live) -> None:
    """Serve the page until its stages are over.

    Args:
        stages: The servos, by the name that the page gives them.
        live: The page's place.
    """

    async def attend(connection: ServerConnection) -> None:
        request = connection.request
        stage = stages.get(servo_of(request)) if request is not None else None
        if stage is None:
            await connection.close(1008, "the address names no servo of this page")
        else:
            await stage.attend(connection)

    def judge(request: Request) -> Response | None:
        return judged(request, live.host, FOLDERS)

    server = await opened(socket.socket(fileno=live.descriptor), attend, judge)
    await asyncio.gather(*(stage.serve() for stage in stages.values()))
    await closed(server)


def main() -> None:
    """Serve until told to end."""
    orders = read_orders()
    log_to(Path(orders["log"]))
    ends = ended_by(signal.SIGTERM)
    die_with_parent(orders["parent"], signal.SIGKILL)
    live = Live(**orders["live"])
    stages = {}
    for name, descriptor in orders["servos"].items():
        line = socket.socket(fileno=descriptor)
        line.setblocking(False)
        stages[name] = Stage(line, live, ends)
    try:
        asyncio.run(serve_lesson(stages, live))
    except OSError as error:
        say({"trouble": f"the page is gone ({error.strerror or error})"})


if __name__ == "__main__":
    main()
