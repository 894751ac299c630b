"""Makes the changes of a running wall: checks, computes, hands over, and answers."""

from __future__ import annotations

import socket
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, Final

from haptic_wall.controller.errors import ConfigError, HapticWallError, UserError
from haptic_wall.controller.guard.decision_report import decision_report
from haptic_wall.controller.live.log_events import send_event
from haptic_wall.controller.live.run_socket import NOT_MADE, OVER
from haptic_wall.controller.runtime.assembly import decision_in_force
from haptic_wall.controller.runtime.changeover import MOST_J, Obstacle
from haptic_wall.controller.runtime.changes import Changes
from haptic_wall.controller.runtime.handover import Offers, Settled
from haptic_wall.controller.runtime.safety import REASONS
from haptic_wall.controller.runtime.telemetry import LoopState, Telemetry, Word
from haptic_wall.controller.settings.axis_names import split_path
from haptic_wall.controller.settings.changes import changed, difference
from haptic_wall.controller.settings.config import RUNS, Config
from haptic_wall.hw.errors import ExplainedError
from haptic_wall.hw.names import did_you_mean

START_S: Final = 1.0
"""Least wait for the servo's start [s]"""
_NOT_STARTED: Final = "the servo has not been started yet"
LOOP_S: Final = 2.0
"""Longest wait for the loop to say what became of a change [s]"""
LEAST_S: Final = 0.3
"""Least time for the loop to take a change and to try it [s]"""
_SHOWN: Final = 300
"""Characters of a request in the log"""


@dataclass(slots=True)
class _Asked:
    """The change at hand."""

    sets: list[str]
    axis: int
    new: Config
    until_s: float
    began_s: float
    number: int = 0
    """0: the loop has not got it, as the servo has not been started yet"""
    withdrawn_s: float | None = None
    why: str = ""
    """Why it was withdrawn"""


class ChangeDesk:
    """Makes one change at a time.

    Args:
        config: Configuration in force at the start of the run.
        telemetry: Telemetry of the run.
        offers: To the loop.
        tell: Called with each change, for report and log.
    """

    def __init__(
        self,
        config: Config,
        telemetry: Telemetry,
        offers: Offers,
        tell: Callable[[dict[str, Any]], None],
    ) -> None:
        self._names, self._configs = list(config.each), list(config.each.values())
        self._telemetry = telemetry
        self._words = telemetry.words
        self._offers = offers
        self._tell = tell
        self._changes: Changes | None = None
        self._asked: _Asked | None = None

    @classmethod
    def of(cls, orders: Mapping[str, Any], tell: Callable[[dict[str, Any]], None]) -> ChangeDesk:
        """Return the desk of a run, by the orders of its process."""
        config = Config.model_validate_json(orders["config"], context=RUNS)
        telemetry = Telemetry(orders["telemetry"], axes=len(config.each), mapped=False)
        to_log = socket.socket(fileno=orders["to_log"])

        def told(change: dict[str, Any]) -> None:
            tell({"change": change, "logged": send_event(to_log, change)})

        return cls(config, telemetry, Offers(telemetry), told)

    def begin(self, sets: list[str], wait_s: float) -> dict[str, Any] | None:
        """Check and compute a change, and send it to the loop.

        Args:
            sets: Changes as ``PATH=VALUE``.
            wait_s: Longest wait for its moment [s].

        Returns:
            The answer, if there already is one.
        """
        began_s = time.monotonic()
        try:
            axis, own = self._addressed(sets)
            new = changed(self._configs[axis], own)
            asked = self._asked = _Asked(sets, axis, new, 0.0, began_s)
            if not difference(self._configs[axis], new):
                self._asked = None
                return {"applied": True, "changed": {}, "waited_s": 0.0}
        except ExplainedError as error:
            return self._refused(sets, error)
        asked.until_s = began_s + max(wait_s, START_S)
        return self._sent(asked, wait_s)

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

    def _sent(self, asked: _Asked, wait_s: float) -> dict[str, Any] | None:
        """Compute the change at hand and send it to the loop, once the servo is known.

        Returns:
            The answer, if there already is one.
        """
        try:
            changes = self._known()
            if changes is None:
                return None
            change = changes.computed(asked.new, asked.axis)
            asked.number = change.number
            self._offers.send(change)
        except ExplainedError as error:
            return self._refused(asked.sets, error)
        asked.began_s = time.monotonic()
        asked.until_s = asked.began_s + max(wait_s, LEAST_S)
        return None

    def look(self) -> dict[str, Any] | None:
        """Return the answer to the change at hand; None: it waits."""
        asked = self._asked
        if asked is None:
            return None
        if not asked.number:
            return self._look_for_start(asked)
        settled = self._offers.settled(asked.number)
        if settled is not None and settled.row >= 0:
            return self._made(asked, settled)
        now_s = time.monotonic()
        if asked.withdrawn_s is None:
            # Where its axis has tripped it is settled before the loop tells the reason.
            if self._words[Word.STATE] != LoopState.RUNNING:
                asked.why = self._over()
                self._give_up(asked)
            elif now_s > asked.until_s:
                asked.why = self.obstacle() or "the loop has not made the change in time"
                self._give_up(asked)
        elif settled is not None or now_s > asked.withdrawn_s + LOOP_S:
            return self._not_made(asked.why)  # the loop has ended
        return None

    def _look_for_start(self, asked: _Asked) -> dict[str, Any] | None:
        """Send the change at hand if the servo has been started; return an answer if it is over."""
        if asked.withdrawn_s is not None:
            return self._not_made(asked.why)
        left_s = asked.until_s - time.monotonic()
        told = self._sent(asked, max(0.0, left_s))
        if told is not None or asked.number:
            return told
        ended = self._words[Word.STATE] > LoopState.RUNNING or self._words[Word.STOP]
        if ended:
            return self._not_made(self._over())
        return self._not_made(_NOT_STARTED) if left_s < 0.0 else None

    def obstacle(self) -> str:
        """Return why the change at hand waits, as words; empty: it does not."""
        if self._asked is not None and not self._asked.number:
            return _NOT_STARTED
        kind, size = self._offers.obstacle
        return obstacle_text(kind, size)

    def withdraw(self) -> None:
        """Give the change at hand up."""
        if self._asked is not None and self._asked.withdrawn_s is None:
            self._asked.why = "the client has closed its connection"
            self._give_up(self._asked)

    def give_up(self) -> dict[str, Any]:
        """Give the change at hand up: the run is over; return the answer."""
        asked = self._asked
        assert asked is not None
        settled = self._offers.settled(asked.number) if asked.number else None
        if settled is not None and settled.row >= 0:
            return self._made(asked, settled)
        return self._not_made(self._over())

    def _over(self) -> str:
        """Say that the run is over, and its reason and axis as far as the loop has told them."""
        number, axis = self._words[Word.REASON], self._words[Word.STOP_AXIS]
        reason = f": {REASONS[number - 1]}" if number else ""
        return f"{OVER}{reason}{f' of {self._names[axis - 1]}' if axis else ''}"

    def _give_up(self, asked: _Asked) -> None:
        asked.withdrawn_s = time.monotonic()
        if asked.number:
            self._offers.withdraw(asked.number)

    def _known(self) -> Changes | None:
        if self._changes is None:
            servos = self._offers.servos()
            if servos is not None:
                self._changes = Changes(self._configs, servos)
        return self._changes

    def _made(self, asked: _Asked, settled: Settled) -> dict[str, Any]:
        changes = self._changes
        assert changes is not None and changes.decided is not None
        new_values = {
            f"{self._prefix(asked.axis)}{path}": value
            for path, value in difference(self._configs[asked.axis], asked.new).items()
        }
        self._configs[asked.axis] = asked.new
        self._asked = None
        servo = changes.servos[asked.axis]
        told = decision_in_force(asked.new, servo, changes.decided, settled.bin)
        guard = decision_report(told)
        made_ns = self._made_ns(settled.row)
        answer = {
            "applied": True,
            "changed": new_values,
            "waited_s": max(0.0, made_ns * 1e-9 - asked.began_s),
            "row": settled.row,
            "guard": {
                name: guard[name] for name in ("requested", "commanded", "binding", "reasons")
            },
        }
        self._event(asked.sets, "applied", "", answer, made_ns)
        return answer

    def _made_ns(self, row: int) -> int:
        """Return when the tick with a change was due [ns]."""
        rows, _ = self._telemetry.read(row, 1)
        return int(rows[0, 0]["deadline_ns"]) if len(rows) else self._now_ns()

    def _now_ns(self) -> int:
        """Return the time on the loop's clock [ns]."""
        return time.monotonic_ns() - self._words[Word.OFFSET_NS]

    def _not_made(self, why: str) -> dict[str, Any]:
        asked, self._asked = self._asked, None
        assert asked is not None
        text = f"not applied: {why}"
        self._event(asked.sets, "not applied", why, {})
        return {"error": text, "field": None, "advice": None, "exit_status": NOT_MADE}

    def _refused(self, sets: list[str], error: ExplainedError) -> dict[str, Any]:
        self._asked = None
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
    """Say why a change waits."""
    match kind:
        case Obstacle.NONE:
            return ""
        case Obstacle.NOT_ON:
            return "the wall has not come on yet"
        case Obstacle.READING:
            return "position and speed of the shaft are not known"
        case Obstacle.PROBED:
            return "the wall is being probed for an oscillation"
        case Obstacle.REDUCED:
            return (
                "an oscillation has reduced the wall: only a lower stiffness is accepted until the "
                "full wall is requested (SIGUSR1)"
            )
        case Obstacle.ENERGY:
            return (
                "at the shaft's position the spring of the new wall would hold "
                f"{1e3 * size:.3g} mJ more than that of the old one, wanted at most "
                f"{1e3 * MOST_J:g} mJ; move the shaft out of the wall"
            )
        case Obstacle.TORQUE:
            return (
                f"the torque would jump by {size:.3g} N·m, wanted at most safety.engage_torque; "
                "move the shaft to a position where both walls have the same torque"
            )
        case Obstacle.DELAY:
            return (
                f"the shaft moves at {size:.3g} rad/s, too fast for a change of the delay; let it "
                "come to rest"
            )
