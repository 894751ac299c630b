"""The supervisor: starts, watches and ends the processes of a run, and cuts the torque in need.

The command's own process is the supervisor. It opens the port, passes its descriptor to the loop's
process and stays silent. It writes to the bus only when the loop is dead or hung, and then nothing
but Torque Enable 0. The recorder and, where requested, the emulated bus are processes too.
"""

from __future__ import annotations

import contextlib
import os
import signal
import time
from collections.abc import Iterator, Sequence
from dataclasses import asdict, replace
from typing import Any

from haptic_wall.controller.live.log_events import event_sockets
from haptic_wall.controller.processes.children import Child
from haptic_wall.controller.processes.door import Door
from haptic_wall.controller.processes.emulator import emulated_bus, emulator_arguments
from haptic_wall.controller.processes.hold import gone_texts
from haptic_wall.controller.processes.loop_process import Orders
from haptic_wall.controller.processes.loop_watch import END_S, START_S, LoopWatch
from haptic_wall.controller.processes.outside import Outside
from haptic_wall.controller.processes.plan import Ended, Plan, Tell
from haptic_wall.controller.processes.recorder_monitor import RecorderMonitor
from haptic_wall.controller.processes.row_count import RowCount
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
from haptic_wall.hw.clock import MonotonicClock, ready
from haptic_wall.hw.elastic import PATIENCE_S, PLACE, SENT, TAKEN
from haptic_wall.hw.errors import Problem, ServoError
from haptic_wall.hw.open import backend, cut_torque, open_port, port_users

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
        self._torque_off: bool | None = None
        self._rows = RowCount(telemetry, plan, self._tell)
        self._warnings: list[str] = []
        self._realtime: list[dict[str, Any]] = []
        self._result: dict[str, Any] | None = None
        self._refused: Problem | None = None
        self._period_ns = plan.config.period_ns
        self._settings = plan.config.servo_settings()
        self._port: int | None = None
        self._key: int | None = None
        self._outside = Outside(MonotonicClock(), plan.config.servo.kind == "hardware")
        self._core, self._others = pick_cores(plan.config.realtime.core)

    def run(self) -> Ended:
        """Start the children, watch them to the end of the run, and end all of them.

        Raises:
            ServoError: The servo could not be started; the message also has every note of the run.
        """
        with self._away_from_the_loop(), contextlib.ExitStack() as children:
            to_log, self._events = event_sockets()
            children.enter_context(to_log)
            children.enter_context(self._events)
            self._door = Door(
                self._plan, self._telemetry, self._tell_person, self._others, to_log.fileno()
            )
            children.callback(self._door.close)
            emulator = self._start_emulator(children)
            if emulator is not None and self._port is None:
                return self._stopped_before_the_start()
            log = RecorderMonitor(self._start_recorder, self._words, self._tell, time.monotonic())
            children.callback(log.close)
            self._open_key(children)
            loop = self._start_loop(children)
            reason, found = self._outside.verdict(self._watch(loop, emulator, log))
            self._cause = "; ".join(filter(None, (found, self._cause)))
            # First: its last events go into the log.
            self._door.close("; ".join(filter(None, (str(reason), self._cause))))
            self._warnings += [*log.end(), *self._outside.notes()]
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
            self._torque_off,
            lacking=log.lacking,
            changes=self._door.changes,
            unlogged=self._door.unlogged,
        )

    def _stopped_before_the_start(self) -> Ended:
        """Return the outcome of a run stopped before there was a bus, and so without torque."""
        return Ended(End.INTERRUPTED, self._rows.statistics, 0, 0, cut=True)

    @contextlib.contextmanager
    def _away_from_the_loop(self) -> Iterator[None]:
        """Keep this process off the loop's core, which a hung real-time loop occupies."""
        before = os.sched_getaffinity(0)
        os.sched_setaffinity(0, self._others)
        try:
            yield
        finally:
            os.sched_setaffinity(0, before)

    def _start_emulator(self, children: contextlib.ExitStack) -> Child | None:
        """Start the emulated bus, if requested, and open the port; None: stopped before."""
        settings, plan = self._settings, self._plan
        emulator = None
        if plan.config.servo.kind == "emulated":
            hand, shared = self._hand(), self._telemetry.descriptor if plan.elastic else None
            arguments = emulator_arguments(settings, plan.witness, hand=hand, elastic=shared)
            stopped, inherited = (
                lambda: bool(self._words[Word.STOP]),
                [each for each in (hand, shared) if each is not None],
            )
            emulator, path = children.enter_context(
                emulated_bus(arguments, self._others, stopped, START_S, inherited)
            )
            if path is None:
                return emulator
            settings = replace(settings, port=path)
        self._port = open_port(settings)
        if self._port is None:
            return emulator
        children.callback(os.close, self._port)
        self._outside.users = users = port_users(self._port)
        if users is not None:
            children.callback(users.close)
        return emulator

    def _start_recorder(self, resume: bool) -> Child:
        descriptor = self._telemetry.descriptor
        orders = {
            "telemetry": descriptor,
            "parent": os.getpid(),
            "log": str(self._plan.log),
            "period_ns": self._period_ns,
            "metadata": self._plan.metadata,
            "resume": resume,
            "force": self._plan.force,
            "events": self._events.fileno(),
        }
        return Child(
            "recorder",
            ["haptic_wall.controller.processes.recorder"],
            orders,
            [descriptor, self._events.fileno()],
            self._others,
        )

    def _hand(self) -> int | None:
        """Return the descriptor of the memory of a person's hand; None: the servo has none."""
        return None if self._door.hand is None else self._door.hand.descriptor

    def _open_key(self, children: contextlib.ExitStack) -> None:
        """Open the dead man's device; the dead man counts as released until the loop reads it.

        Raises:
            UserError: It cannot be opened any more.
        """
        if self._plan.hold is None:
            return
        self._words[Word.HELD_NS] = 0
        self._key = self._plan.hold.open()
        if self._key is not None:
            children.callback(os.close, self._key)

    def _start_loop(self, children: contextlib.ExitStack) -> Child:
        plan, hand = self._plan, self._hand()
        key = None
        if self._key is not None and plan.hold is not None:
            key = self._key, plan.hold.key, plan.hold.path
        orders = Orders(
            config=plan.config.model_dump_json(),
            telemetry=self._telemetry.descriptor,
            port=self._port,
            parent=os.getpid(),
            core=self._core,
            duration_s=plan.duration_s,
            program=[asdict(phase) for phase in plan.program],
            hand=hand,
            key=key,
            elastic=plan.elastic,
        )
        passed = (self._telemetry.descriptor, hand, self._port, self._key)
        descriptors = [each for each in passed if each is not None]
        # On its core from the first: on two cores the other one is busy with the other starts.
        module = "haptic_wall.controller.processes.loop_process"
        loop = Child("loop", [module], asdict(orders), descriptors, {self._core})
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
            news = self._wait_for((loop.pidfd, loop.output))
            now = time.monotonic()
            if self._outside.look():
                self._words[Word.STOP] = 1
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
                if emulator is not None and emulator.halted():
                    self._words[Word.COUPLED] = 0  # the loop waits for it no longer
            if emulator is not None and emulator.ended():
                self._words[Word.COUPLED] = 0
                watch.asked()
        return self._reason(loop, emulator)

    def _reason(self, loop: Child, emulator: Child | None) -> StopReason:
        """Return the stop reason of a loop that has ended."""
        self._hear(loop)
        failed = self._bus_failure(emulator)
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
            if self._words[Word.STATE] not in (LoopState.STARTING, LoopState.TORQUE_OFF):
                self._cut_unconfirmed()
            return End.REFUSED
        return self._cut(loop, Trip.LOOP_DIED, "")

    def _tell(self, text: str) -> None:
        """Tell a person, at the terminal and on the page."""
        self._tell_person(text)
        self._door.pass_on(text)

    def _wait_for(self, descriptors: Sequence[int]) -> bool:
        """Wait for news on a descriptor or for the next check; return whether there is news."""
        pause_s = until_idle_window(self._words, self._period_ns, POLL_S)
        # Not poll(): its whole milliseconds would miss the idle window.
        return bool(ready(descriptors, pause_s))

    def _cut_overdue(self, loop: Child, emulator: Child | None, overdue: str) -> StopReason:
        """End a loop that hangs or ends too late; return the stop reason."""
        served, failed = bool(self._words[Word.HEAD]), self._bus_failure(emulator)
        reason = self._cut(loop, Trip.LOOP_HUNG, overdue)
        self._hear(loop)
        if self._result is not None:  # the session is over; only its process does not end
            reason = stop_reason(self._result["stop_reason"])
        elif failed:
            self._cause = failed
            return Trip.SERVO_LOST
        elif self._words[Word.STOP] and not served:  # a slow start after the stop request
            reason = End.INTERRUPTED
        else:
            return reason
        self._warnings += filter(None, (self._cause, failed))
        self._cause = ""
        return reason

    def _bus_failure(self, emulator: Child | None) -> str:
        """Say how the run's own bus ended, or that it hangs; empty: neither, or there is none."""
        if emulator is None:
            return ""
        if emulator.ended():
            return f"the emulated bus {emulator.exit_text()}"
        doing = emulator.doing()
        words = self._words
        hangs = words[Word.COUPLED] and words[PLACE + TAKEN] != words[PLACE + SENT]
        if hangs or "stopped" in doing:
            return f"the emulated bus {doing or 'hung'}, and took no more bytes"
        return ""

    def _cut(self, loop: Child, trip: Trip, overdue: str) -> StopReason:
        """Take the bus from a dead or hung loop, which cannot write on it any more.

        Args:
            loop: The loop's process.
            trip: The trip that ends the run.
            overdue: The loop's failure, as words after "it"; empty: the loop is dead.
        """
        doing = loop.doing()
        self._words[Word.CUT] = 1
        loop.send(signal.SIGKILL)  # a loop that only seems hung must not write during the cut
        text = self._cut_text()
        loop.wait(END_S)
        what = f"{overdue}{f' (it {doing})' if doing else ''} and was killed"
        self._cause = f"the loop's process {what if overdue else loop.exit_text()}; {text}"
        return trip

    def _cut_unconfirmed(self) -> None:
        """Repeat a torque-off that the ended loop could not read back; note the result."""
        text = self._cut_text()
        if self._torque_off:
            self._warnings.append(f"the loop could not read torque off back; {text}")
        elif self._refused is not None and "could not be read back" not in str(self._refused):
            self._warnings.append(text)  # else the report says so, or the refusal

    def _force_end(self, loop: Child) -> None:
        """End the loop by force, so that it never stays behind with its torque on."""
        if not loop.ended():
            self._words[Word.STOP] = 1
            if not loop.wait(END_S):
                self._cut(loop, Trip.LOOP_HUNG, "was left")
        loop.dismiss(END_S)

    def _cut_text(self) -> str:
        """Switch the torque off; return a sentence on the result."""
        self._words[Word.COUPLED] = 0  # the bus waits for the loop no longer
        make = backend(self._settings.backend)
        self._torque_off = cut_torque(self._settings, self._port, MonotonicClock())
        if make.simulated:
            return "the simulated servo ended with it"
        if self._torque_off:
            return "the supervisor switched the torque off and read it back"
        watchdog = "; its Bus Watchdog should have stopped it" if make.has_watchdog else ""
        return f"torque off could not be read back: switch the servo's power off{watchdog}"

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
                    told, noted = gone_texts(event["why"])
                    self._warnings.append(noted)
                    self._tell(told)
                case "ended":
                    self._result = event["result"]
