"""The supervisor's side of the dial: starts its process, and keeps a list of the changes."""

from __future__ import annotations

import json
import os
import signal
import socket
from pathlib import Path
from typing import Any, Final

from haptic_wall.controller.processes.children import Child
from haptic_wall.controller.processes.plan import Plan, Tell
from haptic_wall.controller.processes.run_socket import MODULE, remove_if_dead, socket_of
from haptic_wall.controller.runtime.telemetry import Telemetry

MOST_KEPT: Final = 1000
"""Number of changes that the report lists: the last ones"""
_END_S: Final = 2.0


class DialMonitor:
    """Listens to the dial's process.

    Attributes:
        changes: The last changes, as events.
        unlogged: Those that the log does not have yet.
        count: Number of all of them.
    """

    def __init__(self, dial: Child, path: Path, tell: Tell) -> None:
        self._dial = dial
        self._path = path
        self._tell = tell
        self._over = self._closed = False
        self.changes: list[dict[str, Any]] = []
        self.unlogged: list[dict[str, Any]] = []
        self.count = 0

    def look(self) -> None:
        """Take its news."""
        for line in self._dial.lines():
            said = json.loads(line)
            if "trouble" in said:
                self._over = True
                self._tell(f"the running wall cannot be changed: {said['trouble']}")
                continue
            self.count += 1
            self.changes = [*self.changes, said["change"]][-MOST_KEPT:]
            if not said["logged"]:
                self.unlogged = [*self.unlogged, said["change"]][-MOST_KEPT:]
            self._tell(change_text(said["change"]))
        if self._dial.ended() and not self._over:
            self._over = True
            remove_if_dead(self._path)
            self._tell(
                f"the process that takes changes {self._dial.exit_text()}; the wall stays as it is"
            )

    def close(self) -> None:
        """End the process, and take its last news; safe to call twice."""
        if self._closed:
            return
        self._closed = self._over = True
        self._dial.send(signal.SIGTERM)
        self._dial.wait(_END_S)
        self.look()
        self._dial.dismiss(0.0)
        remove_if_dead(self._path)


def start_dial(
    plan: Plan, telemetry: Telemetry, tell: Tell, cores: set[int], to_log: int
) -> tuple[DialMonitor, socket.socket] | None:
    """Start the dial's process; return it and the loop's side of the socket between them.

    Args:
        plan: Plan of the run.
        telemetry: Shared memory of the run.
        tell: Called with messages for a person.
        cores: Cores on which the process runs.
        to_log: Descriptor of the socket that events for the log go to.

    Returns:
        None: this run takes no changes.
    """
    log = plan.log
    if not plan.changeable or plan.program or (log.exists() and not log.is_file()):
        return None
    path = socket_of(log)
    ours, loops = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    with ours:
        orders = {
            "telemetry": telemetry.descriptor,
            "loop": ours.fileno(),
            "to_log": to_log,
            "parent": os.getpid(),
            "config": plan.config.model_dump_json(),
        }
        dial = Child(
            "dial",
            [MODULE, str(path)],
            orders,
            [telemetry.descriptor, ours.fileno(), to_log],
            cores,
        )
    return DialMonitor(dial, path, tell), loops


def change_text(change: dict[str, Any]) -> str:
    """Return a change in one line, for people."""
    by = change["by"]
    who = f"{' '.join(change['set'])}, requested by {by['user']} (process {by['pid']})"
    if change["outcome"] != "applied":
        return f"{change['outcome']}: {who}: {change['why']}"
    commanded = change["commanded"] or {}
    values = ", ".join(
        f"{value:.4g} {unit}"
        for value, unit in (
            (commanded.get("stiffness"), "N·m/rad"),
            (commanded.get("damping"), "N·m·s/rad"),
        )
        if value is not None
    )
    return f"changed: {who}; commanded: {values}"
