"""The supervisor's side of the door: starts its process, hears it, and sends it news of the run."""

from __future__ import annotations

import contextlib
import json
import os
import signal
import socket
import time
from contextlib import ExitStack
from dataclasses import asdict
from typing import Any, Final

from haptic_wall.controller.live.log_events import change_text
from haptic_wall.controller.live.run_socket import MODULE, remove_if_dead, socket_of
from haptic_wall.controller.processes.children import Child
from haptic_wall.controller.processes.hold import PAGE, gone_text
from haptic_wall.controller.processes.loop_watch import END_S
from haptic_wall.controller.processes.plan import Plan, Tell
from haptic_wall.controller.runtime.telemetry import Telemetry
from haptic_wall.hw.hand import SharedHand

MOST_KEPT: Final = 1000
"""Number of changes that the report lists: the last ones"""
_MOST_BYTES: Final = 60_000


class Door:
    """Starts the door's process if the plan asks for it, and listens to it.

    Args:
        plan: Plan of the run.
        telemetry: Shared memory of the run.
        tell: Called with messages for a person.
        cores: Cores on which the process runs.
        to_log: Descriptor of the socket that events for the log go to.

    Attributes:
        changes: The last changes, as events.
        unlogged: Those that the log does not have yet.
        hand: A person's hand on servos that are not real; None: no page has one.
        trouble: Why a dead man on the page is gone; empty: it is not.
    """

    def __init__(
        self, plan: Plan, telemetry: Telemetry, tell: Tell, cores: set[int], to_log: int
    ) -> None:
        self._plan = plan
        self._tell = tell
        self._path = socket_of(plan.log)
        self._child: Child | None = None
        self._news: socket.socket | None = None
        self._over = self._closed = False
        self.changes: list[dict[str, Any]] = []
        self.unlogged: list[dict[str, Any]] = []
        self.hand: SharedHand | None = None
        self.trouble = ""
        log, live = plan.log, plan.live
        takes = plan.changeable and not plan.program and (not log.exists() or log.is_file())
        if not (takes or live):
            return
        with ExitStack() as handed:
            inherited = {"telemetry": telemetry.descriptor}
            if live is not None:
                self._news, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
                inherited["news"] = handed.enter_context(theirs).fileno()
                if plan.config.servo.kind != "hardware" and live.token:
                    servos = plan.config.servos()
                    self.hand = SharedHand.create([(each.sign, each.offset) for each in servos])
                    inherited["hand"] = self.hand.descriptor
            shown = {
                "name": plan.metadata["name"],
                "config": plan.config.model_dump_json(),
                "run": str(self._path),
                "dead_man": plan.hold == PAGE,
            }
            if takes:
                inherited["to_log"] = to_log
            orders = {
                "to_log": None,
                "hand": None,
                **inherited,
                **shown,
                "parent": os.getpid(),
                "period_ns": plan.config.period_ns,
                "live": live and asdict(live),
            }
            descriptors = [*inherited.values(), *([] if live is None else [live.descriptor])]
            self._child = Child("door", [MODULE, str(self._path)], orders, descriptors, cores)

    def look(self) -> None:
        """Take its news, and pass changes on to the page."""
        door = self._child
        if door is None:
            return
        for said in door.said():
            if "change" not in said:
                self._tell(said.get("trouble") or f"--live: {said['page']}")
                if "page" in said:
                    self._release(said["page"])
                continue
            change = said["change"]
            self.changes = [*self.changes, change][-MOST_KEPT:]
            if not said["logged"]:
                self.unlogged = [*self.unlogged, change][-MOST_KEPT:]
            self._tell(change_text(change))
            self._send({"change": change})
        if door.ended() and not self._over:
            self._over = True
            remove_if_dead(self._path)
            gone = f"the process for changes and page {door.exit_text()}"
            self._tell(f"{gone}; the run goes on without it")
            self._release(gone)

    def _release(self, why: str) -> None:
        """Note that the page that holds the dead man is gone, if one does."""
        if self._plan.hold == PAGE and not self.trouble:
            self.trouble = gone_text(why)
            self._tell(self.trouble)

    def pass_on(self, text: str) -> None:
        """Pass on a message for a person to the page."""
        self._send({"note": text, "at_ns": time.monotonic_ns()})

    def close(self, words: str = "") -> None:
        """Tell how the run ended, end the process, and take its last news; safe to call twice.

        Args:
            words: Text about the end; empty: nobody waits for it, and the process is killed.
        """
        if self._closed:
            return
        self.look()
        self._closed = self._over = True
        if words:
            self._send({"ended": words})
        if self._child is not None:
            self._child.send(signal.SIGTERM if words else signal.SIGKILL)
            self._child.wait(END_S)
            self.look()
            self._child.dismiss(0.0)
            remove_if_dead(self._path)
        if self._news is not None:
            self._news.close()
        if self.hand is not None:
            for axis in range(len(self._plan.axes)):
                self.hand.of(axis).release()
            self.hand.close()
            self.hand = None

    def _send(self, what: dict[str, Any]) -> None:
        message = json.dumps(what).encode()
        if self._news is not None and len(message) < _MOST_BYTES:
            with contextlib.suppress(OSError):  # it is gone, or does not read: nothing waits for it
                self._news.send(message, socket.MSG_DONTWAIT)
