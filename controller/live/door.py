"""The door's process: whatever comes from outside while a run lives, and goes there.

It takes changes from other terminals, serves the live page, and streams rows. It may be slow,
flooded, stopped or killed without an effect on the loop or the log.
"""

from __future__ import annotations

import contextlib
import os
import signal
import sys
import threading
import time
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from haptic_wall.controller.live.dial import IDLE_S, Desk, Dial
from haptic_wall.controller.live.run_socket import listening
from haptic_wall.controller.runtime.realtime import die_with_parent
from haptic_wall.controller.system.orders import read_orders, say
from haptic_wall.controller.system.signals import ended_by

if TYPE_CHECKING:
    from haptic_wall.controller.live.stream import Sender

LOAD_S: Final = 3.0
"""Time after the start until the desk is loaded [s]: the loop's start has precedence"""
STREAM_S: Final = 0.02
"""Time that rows gather [s]; too short for a person to notice, and it saves work."""
_PAGE_S: Final = 1.5
"""Longest wait for the page's end [s]"""
_NICE: Final = 5


def main() -> None:
    """Serve until told to end."""
    orders = read_orders()
    ends = ended_by(signal.SIGTERM)
    die_with_parent(orders["parent"], signal.SIGTERM)
    page = None
    if orders["live"] is not None:
        from haptic_wall.controller.live.page_thread import serve_page

        page = threading.Thread(target=serve_page, args=(orders, ends), daemon=True)
        page.start()
    os.nice(_NICE)
    place = Path(sys.argv[1])
    dial = _dial(place, orders) if orders["to_log"] is not None else None
    sender, pause = _sender(orders)
    begun_s = time.monotonic()
    try:
        while not ends():
            if dial is None:
                time.sleep(pause())
            else:
                dial.serve(pause())
                if time.monotonic() > begun_s + LOAD_S:
                    dial.prepare()
            _stream(sender)
    finally:
        if dial is not None:
            dial.close()
            with contextlib.suppress(OSError):
                place.unlink()
        _stream(sender)  # the run is over: its last rows
        if page is not None:
            page.join(_PAGE_S)


def _dial(place: Path, orders: Mapping[str, Any]) -> Dial | None:
    """Return what takes changes at a socket; None: it cannot be made."""
    try:
        listener = listening(place)
    except OSError as error:
        why = f"{place} cannot be made ({error.strerror or error})"
        say({"trouble": f"the running wall cannot be changed: {why}"})
        return None

    def desk() -> Desk:
        from haptic_wall.controller.live.change_desk import ChangeDesk

        return ChangeDesk.of(orders, say)

    return Dial(listener, desk)


def _sender(orders: Mapping[str, Any]) -> tuple[Sender | None, Callable[[], float]]:
    """Return what streams rows, if requested, and for how long to pause between two looks [s]."""
    if orders["stream"] is None:
        return None, lambda: IDLE_S
    from haptic_wall.controller.live.stream import Sender, Stream
    from haptic_wall.controller.runtime.idle_window import until_idle_window
    from haptic_wall.controller.runtime.telemetry import Telemetry

    telemetry, period_ns = Telemetry(orders["telemetry"]), orders["period_ns"]
    sender = Sender(telemetry, Stream(**orders["stream"]), 1e9 / period_ns)
    return sender, lambda: until_idle_window(telemetry.words, period_ns, STREAM_S)


def _stream(sender: Sender | None) -> None:
    for trouble in [] if sender is None else sender.send():
        say({"trouble": trouble})


if __name__ == "__main__":
    main()
