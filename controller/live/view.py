"""Keeps the state of an axis of a run that all pages see, and tells them what changes."""

from __future__ import annotations

import asyncio
import math
import time
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from typing import Any, Final

import numpy as np

from haptic_wall.controller.detector.state import State
from haptic_wall.controller.errors import HapticWallError
from haptic_wall.controller.live.client import Client
from haptic_wall.controller.live.dead_man import DeadMan
from haptic_wall.controller.live.frames import CHANNELS
from haptic_wall.controller.live.marks import Mark, MarkFinder, change_mark
from haptic_wall.controller.live.relay import OFFERED, is_number
from haptic_wall.controller.live.scene import law_over_position
from haptic_wall.controller.live.source import Source
from haptic_wall.controller.runtime.telemetry import (
    FLAG_OFF,
    FLAG_PROBED,
    FLAG_REDUCED,
    FLAG_WARM_UP,
)
from haptic_wall.controller.settings.config import Config
from haptic_wall.controller.system.json_text import plain
from haptic_wall.hw.hand import SharedHand

MOST_NUMBER: Final = 1e6
"""Largest number for a hand [rad or N·m/rad]"""
MOST_MARKS: Final = 1000
"""Events that are kept"""
MOST_LAWS: Final = 200
"""Laws that are kept, each with the time from which it was in force"""
_SAME_DELAY: Final = 0.03
"""Relative change of the delay that is not drawn [1]"""


class View:
    """The state of an axis of a run that all clients see.

    Args:
        config: Configuration of the axis at the start of the run.
        name: Of the run, for people.
        source: Of its rows.
        recorded: Whether the run is a log.
        hand: A person's hand on the simulated servo; None: the run has none.
        dead_man: The dead man; None: no page holds it.
        now_ns: The present time on the loop's clock [ns].

    Attributes:
        dead_man: See above.
        now_ns: See above.
    """

    def __init__(
        self,
        config: Config,
        name: str,
        source: Source,
        *,
        recorded: bool,
        hand: SharedHand | None = None,
        dead_man: DeadMan | None = None,
        now_ns: Callable[[], int] = time.monotonic_ns,
    ) -> None:
        self.now_ns = now_ns
        self._hand = hand
        self.dead_man = dead_man
        self._holds: object = None
        self.shaft = math.nan
        """Position of the shaft [rad]; not a number: not known yet"""
        self.config = config
        self.source = source
        self.clients: set[Client] = set()
        self._hello = {
            "kind": "hello",
            "name": name,
            "channels": CHANNELS,
            "rate_hz": config.loop.rate_hz,
            "capacity": source.capacity,
            "recorded": recorded,
            "hand": hand is not None,
            "dead_man": dead_man is not None,
            "laws": {
                name: {"numbers": kind.numbers, "example": dict(kind.example)}
                for name, kind in OFFERED.items()
            },
            "off": FLAG_WARM_UP | FLAG_OFF,
            "softer": FLAG_PROBED | FLAG_REDUCED,
        }
        self._marks: deque[Mark] = deque(maxlen=MOST_MARKS)
        self._finder = MarkFinder()
        self._tail = 0
        self._started_at = math.nan
        self._span = (math.inf, -math.inf)
        self.stiffness = math.nan
        """Commanded now [N·m/rad]; not a number: not known yet"""
        self.delay = math.nan
        """That the guard uses [s]; not a number: not known yet"""
        self.torque = math.nan
        """Sent last [N·m]; not a number: not known yet"""
        self.off = True
        """The wall is off"""
        self.alarm = False
        """An oscillation is seen now"""
        self._map_of: tuple[Config, float] | None = None
        self._laws: deque[dict[str, Any]] = deque(maxlen=MOST_LAWS)
        self._law_of: tuple[Any, ...] = ()
        self._since_s = 0.0
        self._on_stiffness = config.wall.stiffness
        self._kept: dict[str, dict[str, Any]] = {}
        """The last message of each kind that later clients get too"""
        self.keep(self._wall())

    def welcome(self, client: Client, hello: Mapping[str, Any]) -> None:
        """Send a new client everything that the other clients already have.

        Args:
            client: The page.
            hello: What is its own in the first message.
        """
        client.tell({**self._hello, **hello})
        client.tell({"kind": "marks", "marks": [mark.plain() for mark in self._marks]})
        client.tell({"kind": "laws", "laws": list(self._laws)})
        for known in self._kept.values():
            client.tell(known)
        self.clients.add(client)

    def recall(
        self,
        ended: Mapping[str, Any],
        changes: Sequence[Mapping[str, Any]],
        walls: Sequence[tuple[int, float, Config]],
    ) -> None:
        """Show what a log tells: its rows, the changes, and how the run ended.

        Args:
            ended: The end that the run wrote.
            changes: Of the running wall.
            walls: First row, its time [s] and configuration of each wall, in order.
        """
        for (_, since_s, config), end in zip(
            walls, [*(first for first, _, _ in walls[1:]), self.source.capacity], strict=True
        ):
            self.change(config, since_s)
            self.look(end - self._tail)
            self.draw_law()
        known = [each for each in changes if each.get("at_s") is not None]
        self.add([change_mark(each) for each in known])
        if ended.get("stop_reason"):
            self.end(f"the run ended: {ended['stop_reason']}")

    def grasp(self, client: object, wish: Mapping[str, Any] | None) -> bool:
        """Let a client's hand hold the shaft, or let go; one client holds it at a time.

        Args:
            client: Whose hand.
            wish: ``position`` [rad] and ``stiffness`` [N·m/rad]; None: it lets go.

        Returns:
            False: that is no wish.
        """
        hand, now_ns = self._hand, self.now_ns()
        if hand is None:
            return False
        if wish is None:
            if client is self._holds:
                self._holds = None
                hand.release()
            return True
        numbers = [wish.get("position"), wish.get("stiffness")]
        if not all(is_number(each, MOST_NUMBER) for each in numbers):
            return False
        free = self._holds in (None, client) or hand.look(now_ns) is None
        if free and math.isfinite(self.shaft):
            self._holds = client
            hand.hold(float(wish["position"]), float(wish["stiffness"]), self.shaft, now_ns)
        return True

    def hold(self, client: Client, beat: object) -> bool:
        """Let a client hold the dead man, or let go.

        Args:
            client: Who holds.
            beat: The newest one that the client has; None: it lets go.

        Returns:
            False: that is no beat, or no page holds the dead man.
        """
        if self.dead_man is None:
            return False
        if beat is None:
            self.dead_man.release(client)
        elif type(beat) is int:
            self.dead_man.answer(client, beat, self.now_ns())
        else:
            return False
        return True

    def add(self, marks: list[Mark]) -> None:
        """Send events to all clients."""
        if marks:
            self._marks += marks
            self.tell({"kind": "marks", "marks": [mark.plain() for mark in marks]})

    def change(self, config: Config, since_s: float | None) -> None:
        """Show another configuration, after a change of the running wall.

        Args:
            config: In force.
            since_s: Time of the change, from the run's first row [s]; None: before it.
        """
        self.config = config
        self._since_s = self._since_s if since_s is None else since_s
        self.draw_law()
        self.keep(self._wall())

    def end(self, words: str) -> None:
        """Tell all clients that the run has ended."""
        self.keep({"kind": "ended", "words": words})

    def tell(self, what: dict[str, Any]) -> None:
        """Tell all clients."""
        for client in self.clients:
            client.tell(what)

    def keep(self, what: dict[str, Any]) -> None:
        """Tell all clients, and those that come later, if it is not what they know already."""
        kind = what["kind"]
        if what != self._kept.get(kind):
            self._kept[kind] = what
            self.tell(what)

    def look(self, most: int) -> None:
        """Process the new rows, at most ``most`` of them."""
        origin_ns = self.source.origin_ns()
        rows, tail = self.source.read(self._tail, most)
        if not origin_ns or not len(rows):
            return
        self._tail = tail
        self.add(self._finder.look(rows, origin_ns))
        position = rows["position"][np.isfinite(rows["position"])]
        if len(position):
            self.shaft = float(position[-1])
            if math.isnan(self._started_at):
                self._started_at = float(position[0])
            low, high = self._span
            self._span = min(low, float(position.min())), max(high, float(position.max()))
        self.stiffness = float(rows["stiffness"][-1])
        self._on_stiffness = self.stiffness or self._on_stiffness
        self.delay = float(rows["delay_s"][-1])
        self.torque = float(rows["torque"][-1])
        self.off = bool(rows["flags"][-1] & (FLAG_WARM_UP | FLAG_OFF))
        self.alarm = bool(rows["oscillation"][-1] >= State.SUSTAINED)

    def state(self) -> dict[str, Any]:
        """Return what the strip of all axes shows of this one; null: not known yet.

        ``position`` [rad], the drawn range from ``low`` to ``high`` and the ``edges`` of the law in
        it [rad], whether it pushes at each end of the range (``walls``), ``torque`` [N·m],
        ``stiffness`` [N·m/rad], ``off``, ``alarm``, and whether it ``stopped`` the run.
        """
        law = self._laws[-1] if self._laws else {}
        torque = law.get("torque", [0.0])
        return {
            "position": plain(self.shaft),
            "low": law.get("low"),
            "high": law.get("high"),
            "edges": law.get("edges", []),
            "walls": [torque[0] != 0.0, torque[-1] != 0.0],
            "torque": plain(self.torque),
            "stiffness": plain(self.stiffness),
            "off": self.off,
            "alarm": self.alarm,
            "stopped": self.source.stopped(),
        }

    def draw_law(self) -> None:
        """Send the curve of the law if the law or the range of motion has changed.

        The curve of a wall that is off is that of the wall that was on.
        """
        low, high = self._span
        if math.isnan(self._started_at) or not math.isfinite(self.stiffness):
            return
        wanted = (self.config, self._since_s, float(f"{self._on_stiffness:.3g}"))
        drawn = self._laws[-1] if self._laws else None
        inside = drawn is not None and drawn["low"] <= low and high <= drawn["high"]
        if inside and wanted == self._law_of:
            return
        try:
            law = law_over_position(self.config, self._started_at, self._on_stiffness, low, high)
        except HapticWallError:
            return  # of a log: a law that is not imported
        self._law_of = wanted
        if drawn is not None and drawn["since"] == self._since_s:
            self._laws.pop()
        self._laws.append({"since": self._since_s, **law})
        self.tell({"kind": "laws", "laws": [self._laws[-1]]})

    def tell_health(self) -> None:
        """Send the servo's supply and temperature, if they have changed."""
        if found := self.source.health():
            self.keep({"kind": "health", "volts": found[0], "celsius": found[1]})

    async def draw_map(self) -> None:
        """Tell the guard's limits, where the wall, or the delay, is another one."""
        config, delay = self.config, self.delay
        if not math.isfinite(delay):
            return
        if self._map_of is not None:
            drawn, at = self._map_of
            if drawn is config and abs(delay - at) <= _SAME_DELAY * at:
                return
        self._map_of = config, delay
        try:
            found = await asyncio.to_thread(_limits, config, delay)
        except (ValueError, HapticWallError) as error:  # a wall whose limits are not known
            found = {"trouble": str(error)}
        self.keep({"kind": "map", **found})

    def _wall(self) -> dict[str, Any]:
        data = self.config.model_dump(mode="json")
        # Several axes share a delay, which cannot be changed: no knob.
        steps = data["delay"]["steps"] if self.source.alone else None
        told = {"wall": data["wall"], "delay_steps": steps, "travel": data["safety"]["travel"]}
        return {"kind": "wall", **told}


def _limits(config: Config, delay: float) -> dict[str, Any]:
    """Return ``guard_map``, whose import takes longer than what the first curve needs."""
    from haptic_wall.controller.live.guard_map import guard_map

    return guard_map(config, delay)
