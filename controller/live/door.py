"""The door's process: whatever comes from outside while a run lives, and goes there.

It takes changes from other terminals and serves the live page. It may be slow,
flooded, stopped or killed without an effect on the loop or the log.
"""

from __future__ import annotations

import contextlib
import functools
import os
import signal
import socket
import sys
import threading
import time
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from haptic_wall.controller.live.dial import IDLE_S, serve
from haptic_wall.controller.live.run_socket import listening
from haptic_wall.controller.runtime.realtime import die_with_parent
from haptic_wall.controller.system.orders import read_orders, say
from haptic_wall.controller.system.signals import ended_by

if TYPE_CHECKING:
    from haptic_wall.controller.live.change_desk import ChangeDesk

LOAD_S: Final = 3.0
"""Time after the start until the desk is loaded [s]: the loop's start has precedence"""
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
        page = threading.Thread(target=_page, args=(orders, ends), daemon=True)
        page.start()
    os.nice(_NICE)
    place = Path(sys.argv[1])
    listener = None if orders["to_log"] is None else _listener(place)

    @functools.cache
    def desk() -> ChangeDesk:
        from haptic_wall.controller.live.change_desk import ChangeDesk

        return ChangeDesk.of(orders, say, ends)

    begun_s = time.monotonic()
    try:
        while not ends():
            if listener is None:
                time.sleep(IDLE_S)
            else:
                serve(listener, desk, ends)
                if time.monotonic() > begun_s + LOAD_S:
                    desk()
    finally:
        if listener is not None:
            listener.close()
            with contextlib.suppress(OSError):
                place.unlink()
        if page is not None:
            page.join(_PAGE_S)


def _page(orders: Mapping[str, Any], ends: Callable[[], bool]) -> None:
    # what reads the rows takes most of a second to import
    from haptic_wall.controller.live.running_view import serve_page

    serve_page(orders, ends)


def _listener(place: Path) -> socket.socket | None:
    """Return the socket that takes changes; None: it cannot be made."""
    try:
        return listening(place)
    except OSError as error:
        why = f"{place} cannot be made ({error.strerror or error})"
        say({"trouble": f"the running wall cannot be changed: {why}"})
        return None


if __name__ == "__main__":
    main()
