"""Runs an experiment's program on a servo of any backend, as a run of its own; returns its rows.

Simulated, emulated and real servos run as the wall itself does: the same start-up, safety checks,
supervisor and log. Every run's log is kept.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import asdict, dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from haptic_wall import __version__
from haptic_wall.controller.errors import HapticWallError, UserError
from haptic_wall.controller.experiments.holding import changed
from haptic_wall.controller.laws.program import Phase
from haptic_wall.controller.logs.file import SUFFIX, refuse_other
from haptic_wall.controller.logs.reader import LogReader
from haptic_wall.controller.processes.plan import Ended, LogState, Plan
from haptic_wall.controller.processes.run import run
from haptic_wall.controller.processes.run_report import exit_status, explained
from haptic_wall.controller.runtime.machine_setup import START
from haptic_wall.controller.runtime.safety import AFTER_STALL, End, StopReason, Trip
from haptic_wall.controller.runtime.telemetry import FLAG_WARM_UP, ROW
from haptic_wall.controller.settings.config import Config
from haptic_wall.controller.system.files import would_be_lost
from haptic_wall.hw.errors import Problem, ServoLostError, ServoMissingError

_GONE = {Trip.SERVO_LOST, Trip.HARDWARE_ERROR, Trip.TORQUE_LOST, Trip.SERVO_HEALTH}
_PASSING = {Trip.LOSSES_IN_ROW, Trip.LOSS_RATE, Trip.MISSED_PERIODS, Trip.LOOP_HUNG}
_OF_MOTION = {Trip.OVERSPEED, Trip.OSCILLATION}


class ExperimentInterruptedError(HapticWallError):
    """A person ended the run; its log has the rows until then."""

    exit_status = 130


class ExperimentTrippedError(HapticWallError):
    """A trip ended the run; the message names and explains it.

    Attributes:
        stop_reason: A ``Trip``, or ``End.REFUSED``
        fault: Why the rows until then cannot be used; None: none is missing.
        torque_off: Torque off was read back.
        stalled: This computer stalled just before.
    """

    def __init__(
        self,
        stop_reason: StopReason,
        message: Problem | str,
        fault: Problem | None = None,
        torque_off: bool = True,
        stalled: bool = False,
    ) -> None:
        super().__init__(message)
        self.exit_status = exit_status(stop_reason)
        self.stop_reason = stop_reason
        self.fault = fault
        self.torque_off = torque_off
        self.stalled = stalled

    def __str__(self) -> str:
        return f"{self.stop_reason}: {self.problem}"

    @property
    def gone(self) -> bool:
        """Whether the servo must be examined before it may move again."""
        return self.stop_reason in _GONE

    @property
    def of_motion(self) -> bool:
        """Whether a too stiff wall can be the cause."""
        return self.stop_reason in _OF_MOTION

    @property
    def passing(self) -> bool:
        """Whether the machine or the bus lost time, and the same may be run again."""
        late = self.stalled and self.stop_reason in AFTER_STALL
        return (late or self.stop_reason in _PASSING) and self.torque_off

    def __reduce__(self) -> tuple[type[ExperimentTrippedError], tuple[object, ...]]:
        """Return the parts for pickling, so that the error survives a process boundary."""
        rest = (self.fault, self.torque_off, self.stalled)
        return type(self), (self.stop_reason, self.problem, *rest)


@dataclass(frozen=True, slots=True)
class Played:
    """The result of a program's run."""

    rows: NDArray[np.void]
    """Shape (n,), dtype ``telemetry.ROW``; without the warm-up"""
    log: Path
    repeated: StopReason | None = None
    """Trip that ended a first run of the same program; None: there was none"""


class Testbed:
    """Runs programs on the servo of a configuration, and keeps the logs.

    The wall and the guard of the configuration are not used: a program has its own stiffness.
    Safety limits, inserted delay, schedule and real-time settings are those of the configuration.
    Positions of a program count from the shaft's position at its start.

    Args:
        config: The servo and its settings.
        folder: Folder for the logs; made if necessary, and removed where no run left one in it.
        tell: Called with messages for a person.

    Attributes:
        config: Configuration of the runs.
        folder: See above.
        tell: See above.

    Raises:
        UserError: The folder cannot be made.
    """

    __test__ = False  # not a test case, despite its name

    def __init__(
        self,
        config: Config,
        folder: Path,
        tell: Callable[[str], None] = lambda _text: None,
    ) -> None:
        self.config = changed(config, guard={"mode": "off"}, wall={"side": "both"})
        self.folder = folder
        self.tell = tell
        self._start_told = ""
        self._made = not folder.exists()
        try:
            folder.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise UserError(
                f"the folder cannot be made ({error.strerror})",
                field="--out",
                given=folder,
                advice="name another place",
            ) from error

    def play(self, name: str, phases: Sequence[Phase], delay_steps: int | None = None) -> Played:
        """Run a program from its beginning to its end, torque off before and after.

        A run that lost readings, missed periods or a stall of this computer have ended is repeated
        once, and so is one whose emulated servo did not answer at the start.

        Args:
            name: Name of its log; an existing one is replaced as soon as there are rows.
            phases: At least one phase.
            delay_steps: Periods inserted in place of the configuration's.

        Raises:
            ServoError: The servo could not be started.
            ExperimentInterruptedError: A person has ended it.
            ExperimentTrippedError: A trip has ended it.
            UserError: The log could not be written completely, or a file that is no log is in its
                place.
        """
        try:
            return self._played(name, phases, delay_steps)
        except ExperimentTrippedError as error:
            if not error.passing:
                raise
            self.tell(f"{name}: {error.stop_reason}; once more")
            first: StopReason = error.stop_reason
        except (ServoLostError, ServoMissingError) as error:
            if self.config.servo.kind != "emulated":
                raise  # a cable may be loose: it is looked at first
            self.tell(f"{name}: {error} The emulator got no processor time; once more")
            first = Trip.SERVO_LOST
        return replace(self._played(name, phases, delay_steps), repeated=first)

    def _played(self, name: str, phases: Sequence[Phase], delay_steps: int | None) -> Played:
        config = self.config
        if delay_steps is not None:
            config = changed(config, delay={"steps": delay_steps})
        log = self.folder / f"{name}{SUFFIX}"
        if would_be_lost(log):
            refuse_other(log)
        metadata = {
            "program": f"haptic-wall {__version__}",
            "name": name,
            "config": config.model_dump(mode="json"),
            "phases": [asdict(phase) for phase in phases],
        }
        plan = Plan(
            config=config,
            duration_s=sum(phase.seconds for phase in phases) + 1.0,
            log=log,
            metadata=metadata,
            witness=None,
            program=tuple(phases),
            force=True,
        )
        self.folder.mkdir(parents=True, exist_ok=True)
        try:
            ended = run(plan, self._tell_new)
        finally:
            if self._made:
                with suppress(OSError):  # it holds logs
                    self.folder.rmdir()
        if ended.stop_reason == End.INTERRUPTED or ended.asked:
            kept = f"{log} holds the recorded rows" if ended.logged else ""
            raise ExperimentInterruptedError("interrupted", advice=kept)
        if ended.stop_reason != End.DURATION:
            raise ExperimentTrippedError(
                ended.stop_reason,
                explained(ended, config.servo) or "",
                _fault(log, ended),
                ended.torque_off is True,
                bool((ended.result or {}).get("stalled")),
            )
        if fault := _fault(log, ended):
            raise UserError(fault)
        rows = recorded(log)
        if rows.size == 0:
            raise UserError(_unusable(f"the log {log} holds no rows"))
        return Played(rows, log)

    def _tell_new(self, text: str) -> None:
        """Pass messages on, but the machine's granted settings only once."""
        if text.startswith(START):
            if text == self._start_told:
                return
            self._start_told = text
        self.tell(text)


def recorded(log: Path) -> NDArray[np.void]:
    """Return the rows of a log without the warm-up, shape (n,); none without a log."""
    rows = LogReader.open(log).rows() if log.exists() else np.empty(0, ROW)
    on: NDArray[np.void] = rows[(rows["flags"] & FLAG_WARM_UP) == 0]
    return on


def _fault(log: Path, ended: Ended) -> Problem | None:
    """Return why a log lacks rows of its run; None: it does not.

    A partial motion would be fitted as if it were complete.
    """
    if ended.lacking == 0 and ended.logged:
        return None
    if ended.log is LogState.NONE:
        return _unusable(f"the log {log} holds no rows")
    return _unusable(f"the log {log} is not whole ({'; '.join(ended.warnings)})")


def _unusable(fault: str) -> Problem:
    return Problem(f"{fault}, so nothing is measured from it", advice="name another place")
