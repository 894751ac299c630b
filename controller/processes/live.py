"""The supervisor's side of the live page: starts its process, and sends it news of the run.

A page that shows several runs, as ``haptic-wall demo`` does, has a process already; it gets what a
new one would inherit.
"""

from __future__ import annotations

import contextlib
import json
import os
import signal
import socket
import time
from dataclasses import asdict
from typing import Any, Final

from haptic_wall.controller.processes.children import Child
from haptic_wall.controller.processes.live_place import server_log_of
from haptic_wall.controller.processes.plan import Plan, Tell
from haptic_wall.controller.processes.run_socket import socket_of
from haptic_wall.controller.runtime.telemetry import Telemetry
from haptic_wall.hw.hand import SharedHand

MODULE: Final = "haptic_wall.controller.live.process"
_END_S: Final = 2.0
_MOST_BYTES: Final = 60_000
_MOST_ORDERS: Final = 1 << 17
"""Largest orders of a run for a page [bytes]"""


class LiveMonitor:
    """Listens to the page's process, and sends it changes, messages and the end of the run.

    Args:
        server: The process; None: it is not a child of this run.
        news: Socket to the process.
        hand: A person's hand on a servo that is not real; None: the page has none.
        tell: Called with messages for a person.

    Attributes:
        server: See above.
        hand: See above.
    """

    def __init__(
        self, server: Child | None, news: socket.socket, hand: SharedHand | None, tell: Tell
    ) -> None:
        self.hand = hand
        self.server = server
        self._news = news
        self._tell = tell
        self._over = False
        self._changes = 0

    def look(self, changes: list[dict[str, Any]], count: int) -> None:
        """Read the process's messages, and pass on changes of the wall."""
        new = count - self._changes
        self._changes = count
        for change in changes[-new:] if new > 0 else []:
            self._send({"change": change})
        if self.server is None:
            return
        for line in self.server.lines():
            self._tell(f"--live: {json.loads(line)['trouble']}")
        if self.server.ended() and not self._over:
            self._over = True
            self._tell(f"--live: its process {self.server.exit_text()}; the run goes on without it")

    def pass_on(self, text: str) -> None:
        """Pass on a message for a person."""
        self._send({"note": text, "at_ns": time.monotonic_ns()})

    def end(self, words: str) -> None:
        """Tell how the run ended, and end the process; safe to call twice.

        Args:
            words: Text about the end; empty: not known.
        """
        if words:
            self._send({"ended": words})
        if self.server is not None:
            self.server.send(signal.SIGTERM)
            self.server.dismiss(_END_S)
        self._news.close()
        if self.hand is not None:
            self.hand.release()
            self.hand.close()
            self.hand = None

    def _send(self, what: dict[str, Any]) -> None:
        message = json.dumps(what).encode()
        if len(message) < _MOST_BYTES:
            with contextlib.suppress(OSError):  # it is gone, or does not read: nothing waits for it
                self._news.send(message, socket.MSG_DONTWAIT)


def start_live(plan: Plan, telemetry: Telemetry, tell: Tell, cores: set[int]) -> LiveMonitor | None:
    """Start the page's process, or connect to it; return None if the plan has no page."""
    live = plan.live
    if live is None and plan.page is None:
        return None
    ours, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    simulated = plan.config.servo.kind != "hardware"
    turns = live is None or bool(live.token)
    hand = SharedHand.create() if turns and simulated else None
    shown = {
        "name": plan.metadata["name"],
        "config": plan.config.model_dump_json(),
        "run": str(socket_of(plan.log)),
        "dead_man": plan.hold is not None and plan.hold.kind == "page",
    }
    inherited = {"telemetry": telemetry.descriptor, "news": theirs.fileno()}
    inherited |= {} if hand is None else {"hand": hand.descriptor}
    server = None
    with theirs:
        if live is None:
            hand_over(plan.page, shown, inherited)
        else:
            orders = {"hand": None, **inherited, **shown}
            orders |= {"parent": os.getpid(), "live": asdict(live)}
            orders |= {"log": str(server_log_of(plan.log))}
            descriptors = [*inherited.values(), live.descriptor]
            server = Child("live page", [MODULE], orders, descriptors, cores)
    return LiveMonitor(server, ours, hand, tell)


def hand_over(page: int | None, shown: dict[str, Any], inherited: dict[str, int]) -> None:
    """Send the page's process the orders of a run, with the descriptors that belong to them."""
    assert page is not None
    message = json.dumps({**shown, "descriptors": list(inherited)}).encode()
    with (
        socket.socket(fileno=os.dup(page)) as line,
        contextlib.suppress(OSError),  # it is gone: the run goes on without it
    ):
        socket.send_fds(line, [message], list(inherited.values()))


def take_over(line: socket.socket) -> dict[str, Any] | None:
    """Return the orders of the next run that a page shows; None: there are none yet.

    Args:
        line: The other end of the socket ``Plan.page``; it does not block.

    Raises:
        EOFError: No run comes any more.
    """
    try:
        message, received, _, _ = socket.recv_fds(line, _MOST_ORDERS, 3)
    except BlockingIOError:
        return None
    if not message:
        raise EOFError
    orders: dict[str, Any] = json.loads(message)
    return {"hand": None, **orders, **dict(zip(orders["descriptors"], received, strict=True))}
