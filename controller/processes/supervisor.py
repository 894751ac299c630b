"""The supervisor: starts, watches and ends the processes of a run, and cuts the torque in need.

The command's own process is the supervisor. It opens the port, passes its descriptor to the loop's
process and stays silent. It writes to the bus only when the loop is dead or hung, and then nothing
but Torque Enable 0. The recorder and, where requested, the emulated bus are processes too.
"""

from __future__ import annotations

import contextlib
import os
import time
from dataclasses import asdict, replace
from typing import Any

from haptic_wall.controller.live.log_events import event_sockets
from haptic_wall.controller.processes.children import Child, on_cores
from haptic_wall.controller.processes.door_monitor import Door
from haptic_wall.controller.processes.emulator import emulated_bus, emulator_arguments, failure_of
from haptic_wall.controller.processes.hold import PAGE, gone_text, opened
from haptic_wall.controller.processes.loop_watch import END_S, LoopWatch
from haptic_wall.controller.processes.plan import Ended, Plan, Tell
from haptic_wall.controller.processes.recorder_monitor import RecorderMonitor, recorder_starter
from haptic_wall.controller.processes.row_count import RowCount
from haptic_wall.controller.processes.torque_cut import TorqueCut
from haptic_wall.controller.runtime.idle_window import until_idle_window
from haptic_wall.controller.runtime.realtime import pick_cores
from haptic_wall.controller.runtime.safety import (
    AFTER_STALL,
    End,
    StopReason,
    Trip,
    stop_reason,
)
from haptic_wall.controller.runtime.telemetry import LoopState, Telemetry, Word
from haptic_wall.hw.clock import ready
from haptic_wall.hw.elastic import PATIENCE_S
from haptic_wall.hw.errors import Problem, ServoError
from haptic_wall.hw.open import open_port, reserved

POLL_S = 0.02
"""Period of the checks of the heartbeat [s]"""
LOOK_S = 0.25
"""Period of all other checks [s]"""


class Supervisor:
    """Starts the children, watches them, and cuts the torque when the loop cannot.

    Args:
        plan: The run.
        telemetry: The memory that all of them share.
        tell: Called with messages for a person; must not wait for the terminal.
    """

    def __init__(self, plan: Plan, telemetry: Telemetry, tell: Tell) -> None:
        self._plan = plan
        self._telemetry = telemetry
        self._words = telemetry.words
        self._tell_person = tell
        self._cause = ""
        self._rows = RowCount(telemetry, plan, self._tell)
        self._warnings: list[str] = []
        self._realtime: list[dict[str, Any]] = []
        self._result: dict[str, Any] | None = None
        self._refused: Problem | None = None
        self._servos = plan.config.servos()
        self._cut = TorqueCut(self._servos, self._words)
        self._core, self._others = pick_cores(plan.config.realtime.core)

    def run(self) -> Ended:
        """Start the children, watch them to the end of the run, and end all of them.

        Raises:
            ServoError: The servo could not be started; the message also has every note of the run.
        """
        plan = self._plan
        with on_cores(self._others), contextlib.ExitStack() as children:
            to_log, self._events = event_sockets()
            children.enter_context(to_log)
            children.enter_context(self._events)
            self._door = Door(
                plan, self._telemetry, self._tell_person, self._others, to_log.fileno()
            )
            children.callback(self._door.close)
            emulator = self._start_emulator(children)
            if emulator is not None and self._cut.port is None:  # stopped before: without torque
                return Ended(End.INTERRUPTED, self._rows.statistics, 0, 0, cut=True)
            log = RecorderMonitor(
                recorder_starter(plan, self._telemetry.descriptor, self._events, self._others),
                self._words,
                self._tell,
                time.monotonic(),
            )
            children.callback(log.close)
            loop = self._start_loop(children)
            reason = self._watch(loop, emulator, log)
            # First: its last events go into the log.
            told = "; ".join(filter(None, (str(reason), self._cause)))
            given_up = reason is End.INTERRUPTED and not self._words[Word.HEAD]
            self._door.close("" if given_up else told)
            self._warnings += log.end()
            if self._door.trouble:
                self._warnings.append(self._door.trouble)
        self._rows.end()
        if self._refused is not None:
            notes = "; ".join(filter(None, (self._cause, *self._warnings)))
            raise ServoError(self._refused.followed_by(f" ({notes})" if notes else ""))
        words, result = self._words, self._result
        return Ended(
            reason,
            self._rows.statistics,
            words[Word.TICKS] if result is None else result["ticks"],
            words[Word.MISSED] if result is None else result["missed"],
            result,
            self._realtime,
            self._warnings,
            self._cause,
            self._cut.confirmed,
            lacking=log.lacking,
            changes=self._door.changes,
            unlogged=self._door.unlogged,
        )

    def _start_emulator(self, children: contextlib.ExitStack) -> Child | None:
        """Start the emulated bus, if requested, and open the port; None: there is none."""
        plan, emulator, servos = self._plan, None, self._servos
        if plan.config.servo.kind == "emulated":
            hand, shared = self._hand(), self._telemetry.descriptor if plan.elastic else None
            arguments = emulator_arguments(servos, plan.witness, hand=hand, elastic=shared)
            inherited = [each for each in (hand, shared) if each is not None]
            bus = emulated_bus(
                arguments, self._others, lambda: bool(self._words[Word.STOP]), inherited
            )
            emulator, path = children.enter_context(bus)
            if path is None:  # stopped before
                return emulator
            servos = [replace(one, port=path) for one in servos]
        self._cut.port = port = open_port(servos)
        if port is not None:
            children.callback(os.close, port)
            children.enter_context(reserved(port))
        return emulator

    def _hand(self) -> int | None:
        """Return the descriptor of the memory of a person's hand; None: the servo has none."""
        return None if self._door.hand is None else self._door.hand.descriptor

    def _start_loop(self, children: contextlib.ExitStack) -> Child:
        """Start the loop; the dead man counts as released until its device or page is read.

        Raises:
            UserError: The dead man's device cannot be opened any more.
        """
        plan, inherited, key = self._plan, [self._telemetry.descriptor], None
        inherited += [each for each in (self._cut.port, self._hand()) if each is not None]
        if plan.hold is not None:
            self._words[Word.HELD_NS] = 0
            if plan.hold != PAGE:
                key = opened(plan.hold), plan.hold  # named for messages
                children.callback(os.close, key[0])
                inherited.append(key[0])
        orders = {
            "telemetry": self._telemetry.descriptor,
            "port": self._cut.port,
            "hand": self._hand(),
            "key": key,
            "config": plan.config.model_dump_json(),
            "parent": os.getpid(),
            "core": self._core,
            "duration_s": plan.duration_s,
            "program": [asdict(phase) for phase in plan.program],
            "elastic": plan.elastic,
        }
        # On its core from the first: on two cores the other one is busy with the other starts.
        module = "haptic_wall.controller.processes.loop_process"
        loop = Child("loop", [module], orders, inherited, {self._core})
        children.callback(self._force_end, loop)
        return loop

    def _watch(self, loop: Child, emulator: Child | None, log: RecorderMonitor) -> StopReason:
        """Wait until the loop has ended, by itself or by force; return the stop reason."""
        looked = time.monotonic()
        silence_s = self._plan.config.safety.heartbeat_s
        if self._plan.elastic:
            silence_s = max(silence_s, PATIENCE_S)
        watch = LoopWatch(self._words, silence_s, looked)
        while True:
            if self._words[Word.STOP] and self._words[Word.STATE] == LoopState.PREPARING:
                self._cut.take_from(loop)  # its imports and computations may take many seconds
                return End.INTERRUPTED
            # Not poll(): its whole milliseconds would miss the idle window.
            pause_s = until_idle_window(self._words, self._plan.config.period_ns, POLL_S)
            news = bool(ready((loop.pidfd, loop.output), pause_s))
            now = time.monotonic()
            overdue = watch.overdue(now)
            if not news and overdue is None and now < looked + LOOK_S:
                continue
            if loop.ended():
                break
            if overdue is not None:
                return self._cut_overdue(loop, emulator, overdue)
            self._hear(loop)
            log.look(now)
            if now >= looked + LOOK_S:
                self._rows.look()
                self._door.look()
                looked = now
                if self._words[Word.STATE] == LoopState.STARTING and loop.halted():
                    return self._cut_overdue(loop, emulator, "did not start")
                if emulator is not None and emulator.halted():
                    self._words[Word.COUPLED] = 0  # the loop waits for it no longer
            if emulator is not None and emulator.ended():
                self._words[Word.COUPLED] = 0
                watch.asked()
        return self._reason(loop, emulator)

    def _reason(self, loop: Child, emulator: Child | None) -> StopReason:
        """Return the stop reason of a loop that has ended."""
        self._hear(loop)
        failed = failure_of(emulator, self._words)
        if self._result is not None:
            if not self._result["torque_off"]:
                self._cut_unconfirmed()
            reason = stop_reason(self._result["stop_reason"])
            if reason in AFTER_STALL:
                self._cause = failed
            elif failed:
                self._warnings.append(failed)
            return reason
        if failed:
            self._warnings.append(f"{failed}; start it again")
        if self._refused is not None:
            state = self._words[Word.STATE]
            if state > LoopState.STARTING and state != LoopState.TORQUE_OFF:
                self._cut_unconfirmed()
            return End.REFUSED
        self._cause = self._cut.take_from(loop)
        return Trip.LOOP_DIED

    def _tell(self, text: str) -> None:
        """Tell a person, at the terminal and on the page."""
        self._tell_person(text)
        self._door.pass_on(text)

    def _cut_overdue(self, loop: Child, emulator: Child | None, overdue: str) -> StopReason:
        """End a loop that hangs or ends too late; return the stop reason."""
        served, failed = bool(self._words[Word.HEAD]), failure_of(emulator, self._words)
        self._cause = self._cut.take_from(loop, overdue)
        self._hear(loop)
        if self._result is not None:  # the session is over; only its process does not end
            reason = stop_reason(self._result["stop_reason"])
        elif failed:
            self._cause = failed
            return Trip.SERVO_LOST
        elif self._words[Word.STOP] and not served:  # a slow start after the stop request
            reason = End.INTERRUPTED
        else:
            return Trip.LOOP_HUNG
        self._warnings += filter(None, (self._cause, failed))
        self._cause = ""
        return reason

    def _cut_unconfirmed(self) -> None:
        """Repeat a torque-off that the ended loop could not read back; note the result."""
        text = self._cut.now()
        if self._cut.confirmed:
            self._warnings.append(f"the loop could not read torque off back; {text}")
        elif self._refused is not None and "could not be read back" not in str(self._refused):
            self._warnings.append(text)  # else the report says so, or the refusal

    def _force_end(self, loop: Child) -> None:
        """End the loop by force, so that it never stays behind with its torque on."""
        if not loop.ended():
            self._words[Word.STOP] = 1
            if not loop.wait(END_S):
                self._cause = self._cut.take_from(loop, "was left")
        loop.dismiss(END_S)

    def _hear(self, loop: Child) -> None:
        for event in loop.said():
            match event.pop("event"):
                case "realtime":
                    self._realtime = event["settings"]
                case "refused":
                    self._refused = Problem(**event["problem"])
                case "tell":
                    self._tell(event["text"])
                case "key_gone":
                    self._warnings.append(gone_text(event["why"]))
                    self._tell(self._warnings[-1])
                case "ended":
                    self._result = event["result"]
