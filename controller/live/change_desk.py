"""Makes the changes of a running wall: checks, computes, hands over, and answers."""

from __future__ import annotations

import socket
import time
from collections.abc import Callable, Mapping
from typing import Any, Final

from haptic_wall.controller.errors import ConfigError, HapticWallError, UserError
from haptic_wall.controller.guard.bins import Bins
from haptic_wall.controller.guard.decision_report import decision_report
from haptic_wall.controller.live.log_events import send_event
from haptic_wall.controller.live.run_socket import NOT_MADE, OVER
from haptic_wall.controller.runtime import handover
from haptic_wall.controller.runtime.changeover import MOST_J, Obstacle
from haptic_wall.controller.runtime.changes import change_of
from haptic_wall.controller.runtime.handover import Change, KnownServo, Settled
from haptic_wall.controller.runtime.safety import REASONS
from haptic_wall.controller.runtime.telemetry import LoopState, Telemetry, Word
from haptic_wall.controller.settings.axis_names import split_path
from haptic_wall.controller.settings.changes import changed, difference
from haptic_wall.controller.settings.config import RUNS, Config
from haptic_wall.hw.errors import ExplainedError
from haptic_wall.hw.names import did_you_mean

START_S: Final = 1.0
"""Least wait for the servo's start [s]"""
LOOP_S: Final = 2.0
"""Longest wait for the loop to say what became of a change [s]"""
LEAST_S: Final = 0.3
"""Least time for the loop to take a change and to try it [s]"""
_LOOK_S: Final = 0.01
"""Time between two looks at what is waited for [s]"""
_SHOWN: Final = 300
"""Characters of a request in the log"""


class ChangeDesk:
    """Makes one change at a time.

    Args:
        config: Configuration in force at the start of the run.
        telemetry: Telemetry of the run.
        tell: Called with each change, for report and log.
        ends: Returns whether the run is over, also where the loop does not tell it.
    """

    def __init__(
        self,
        config: Config,
        telemetry: Telemetry,
        tell: Callable[[dict[str, Any]], None],
        ends: Callable[[], bool],
    ) -> None:
        self._names = list(config.each)
        self._telemetry = telemetry
        self._words = telemetry.words
        self._tell = tell
        self._ends = ends
        self._configs = list(config.each.values())
        """Of each axis, in force now"""
        self._servos: list[KnownServo] = []
        """Of each axis; empty until they are known"""
        self._number = 0
        """Of the last change"""

    @classmethod
    def of(
        cls,
        orders: Mapping[str, Any],
        tell: Callable[[dict[str, Any]], None],
        ends: Callable[[], bool],
    ) -> ChangeDesk:
        """Return the desk of a run, by the orders of its process."""
        config = Config.model_validate_json(orders["config"], context=RUNS)
        telemetry = Telemetry(orders["telemetry"], axes=len(config.each), mapped=False)
        to_log = socket.socket(fileno=orders["to_log"])

        def told(change: dict[str, Any]) -> None:
            tell({"change": change, "logged": send_event(to_log, change)})

        return cls(config, telemetry, told, ends)

    def change(
        self,
        sets: list[str],
        wait_s: float,
        tell_wait: Callable[[str], None],
        gone: Callable[[], bool],
    ) -> dict[str, Any]:
        """Check and compute a change, send it to the loop, and wait until that has made it.

        Args:
            sets: Changes as ``PATH=VALUE``.
            wait_s: Longest wait for its moment [s].
            tell_wait: Called again and again while the change waits, with the obstacle as words;
                empty: none is known.
            gone: Returns whether the client has gone, so that the change is withdrawn.

        Returns:
            The answer.
        """
        configs, until_s = self._configs, time.monotonic() + max(wait_s, START_S)
        try:
            axis, own = self._addressed(sets)
            new = changed(configs[axis], own)
            if not difference(configs[axis], new):
                return {"applied": True, "changed": {}, "waited_s": 0.0}
            if not self._is_known():
                if why := self._wait(self._is_known, until_s, tell_wait, gone):
                    return self._not_made(sets, why)
                wait_s = until_s - time.monotonic()
            self._number += 1
            change, bins = change_of(self._number, configs[axis], new, self._servos[axis], axis)
            handover.offer(self._telemetry, change)
        except ExplainedError as error:
            return self._refused(sets, error)
        began_ns, until_s = self._now_ns(), time.monotonic() + max(wait_s, LEAST_S)
        why = self._wait(lambda: self._is_made(change), until_s, tell_wait, gone)
        if why:
            self._withdraw(change)
        settled = handover.settled(self._words, change.number)
        if settled is None or settled.row < 0:
            return self._not_made(sets, why)
        return self._made(sets, axis, new, bins, settled, began_ns)

    def _addressed(self, sets: list[str]) -> tuple[int, list[str]]:
        """Return the index of the axis that changes are for, and the changes as for it alone.

        Raises:
            UserError: There are several axes, and they are not for the wall of one.
        """
        for axis, name in enumerate(self._names):
            prefix = self._prefix(axis)
            if not name or (sets and all(each.startswith(f"{prefix}wall.") for each in sets)):
                return axis, [each.removeprefix(prefix) for each in sets]
        found = "no change of the wall of one axis"
        prefixes = dict.fromkeys(split_path(each)[0] for each in sets)
        named = [prefix.split(".")[1] for prefix in prefixes if prefix]
        if unknown := [name for name in named if name not in self._names]:
            near = did_you_mean(unknown[0], self._names)
            found = f"no axis {unknown[0]}{near and f' ({near})'}"
        elif len(named) > 1:
            found = f"changes of {len(named)} axes"
        raise UserError(
            f"found {found}",
            field="set",
            wanted=f"axes.NAME.wall...=VALUE, where NAME is one of {', '.join(self._names)}",
            advice="give a command for each axis",
        )

    def _prefix(self, axis: int) -> str:
        """Return the beginning of the paths of an axis."""
        return f"axes.{self._names[axis]}." if self._names[axis] else ""

    def _wait(
        self,
        done: Callable[[], bool],
        until_s: float,
        tell_wait: Callable[[str], None],
        gone: Callable[[], bool],
    ) -> str:
        """Wait until something is done; return why the wait has ended before; empty: it has not."""
        while not done():
            obstacle = self._obstacle()
            # Where its axis has tripped a change is settled before the loop tells the reason.
            if self._is_over():
                number, axis = self._words[Word.REASON], self._words[Word.STOP_AXIS]
                reason = f": {REASONS[number - 1]}" if number else ""
                return f"{OVER}{reason}{f' of {self._names[axis - 1]}' if axis else ''}"
            if gone():
                return "the client has closed its connection"
            if time.monotonic() > until_s:
                return obstacle or "the loop has not made the change in time"
            tell_wait(obstacle)
            time.sleep(_LOOK_S)
        return ""

    def _is_known(self) -> bool:
        """Whether the servos are known; the loop's process tells them once, as it starts them."""
        if not self._servos:
            self._servos = handover.known_servos(self._telemetry) or []
        return bool(self._servos)

    def _is_made(self, change: Change) -> bool:
        settled = handover.settled(self._words, change.number)
        return settled is not None and settled.row >= 0

    def _is_over(self) -> bool:
        """Whether the loop makes no change any more: it has ended, or is not to start."""
        state, stop = self._words[Word.STATE], self._words[Word.STOP]
        ended = state > LoopState.RUNNING or (stop and state < LoopState.RUNNING)
        return bool(ended) or self._ends()

    def _obstacle(self) -> str:
        if not self._servos:
            return "the servo has not been started yet"
        return obstacle_text(*handover.obstacle(self._words))

    def _withdraw(self, change: Change) -> None:
        """Give a change up, and wait until the loop has settled it; it may have made it already."""
        handover.withdraw(self._words, change.number)
        until_s = time.monotonic() + LOOP_S
        while handover.settled(self._words, change.number) is None and not self._is_over():
            if time.monotonic() > until_s:
                return  # the loop is dead or hangs
            time.sleep(_LOOK_S)

    def _made(
        self,
        sets: list[str],
        axis: int,
        new: Config,
        bins: Bins,
        settled: Settled,
        began_ns: int,
    ) -> dict[str, Any]:
        prefix = self._prefix(axis)
        differing = difference(self._configs[axis], new)
        self._configs[axis] = new
        guard = decision_report(bins.explained(settled.bin))
        made_ns = self._made_ns(settled.row)
        answer = {
            "applied": True,
            "changed": {f"{prefix}{path}": value for path, value in differing.items()},
            "waited_s": max(0.0, (made_ns - began_ns) * 1e-9),
            "row": settled.row,
            "guard": {
                name: guard[name] for name in ("requested", "commanded", "binding", "reasons")
            },
        }
        self._event(sets, "applied", "", answer, made_ns)
        return answer

    def _made_ns(self, row: int) -> int:
        """Return when the tick with a change was due [ns]."""
        rows, _ = self._telemetry.read(row, 1)
        return int(rows[0, 0]["deadline_ns"]) if len(rows) else self._now_ns()

    def _now_ns(self) -> int:
        """Return the time on the loop's clock [ns]."""
        return time.monotonic_ns() - self._words[Word.OFFSET_NS]

    def _not_made(self, sets: list[str], why: str) -> dict[str, Any]:
        text = f"not applied: {why}"
        self._event(sets, "not applied", why, {})
        return {"error": text, "field": None, "advice": None, "exit_status": NOT_MADE}

    def _refused(self, sets: list[str], error: ExplainedError) -> dict[str, Any]:
        field = error.problem.field or ""
        # what was checked as for the axis alone is told by the path that was given
        axis = split_path(sets[0])[0] if field.startswith("wall.") else ""
        problems = error.problems if isinstance(error, ConfigError) else (str(error),)
        text = "; ".join(f"{axis}{problem}" for problem in problems)
        self._event(sets, "refused", text, {})
        return {
            "error": f"refused: {text}",
            "field": f"{axis}{field}" or None,
            "advice": error.problem.remedy,
            "exit_status": error.exit_status if isinstance(error, HapticWallError) else 2,
        }

    def _event(
        self,
        sets: list[str],
        outcome: str,
        why: str,
        answer: dict[str, Any],
        at_ns: int | None = None,
    ) -> None:
        began_ns = self._words[Word.BEGAN_NS]
        at_ns = self._now_ns() if at_ns is None else at_ns
        self._tell(
            {
                "at_s": (at_ns - began_ns) * 1e-9 if began_ns else None,
                "row": answer.get("row"),
                "outcome": outcome,
                "why": why[:_SHOWN] or None,
                "set": [each[:_SHOWN] for each in sets[:_SHOWN]],
                "changed": answer.get("changed"),
                "waited_s": answer.get("waited_s"),
                "commanded": answer.get("guard", {}).get("commanded"),
            }
        )


def obstacle_text(kind: Obstacle, size: float) -> str:
    """Say why a change waits; ``size`` is that of the obstacle, in its unit."""
    return _OBSTACLES[kind].format(size=size, milli=1e3 * size, most=1e3 * MOST_J)


_OBSTACLES: Final = {
    Obstacle.NONE: "",
    Obstacle.NOT_ON: "the wall has not come on yet",
    Obstacle.READING: "position and speed of the shaft are not known",
    Obstacle.PROBED: "the wall is being probed for an oscillation",
    Obstacle.REDUCED: "an oscillation has reduced the wall: only a lower stiffness is accepted "
    "until the full wall is requested (SIGUSR1)",
    Obstacle.ENERGY: "at the shaft's position the spring of the new wall would hold {milli:.3g} mJ "
    "more than that of the old one, wanted at most {most:g} mJ; move the shaft out of the wall",
    Obstacle.TORQUE: "the torque would jump by {size:.3g} N·m, wanted at most "
    "safety.engage_torque; move the shaft to a position where both walls have the same torque",
    Obstacle.DELAY: "the shaft moves at {size:.3g} rad/s, too fast for a change of the delay; let "
    "it come to rest",
}
