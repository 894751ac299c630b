"""Reads and sets the latency timer of FTDI adapters: how long they may hold a short reply.

In their driver's low-latency mode, a flag that any user of the port may set, the file in ``/sys``
says 1. That is the driver's claim: the real time of replies is measured.

Source: Linux, drivers/usb/serial/ftdi_sio.c, ``write_latency_timer`` and ``latency_timer_show``.
"""

from __future__ import annotations

from pathlib import Path

CLASSES = Path("/sys/class/tty")


def timer_file(path: str, classes: Path = CLASSES) -> Path:
    """Return the file with the latency timer of the adapter behind a port, existing or not."""
    return classes / Path(path).resolve().name / "device" / "latency_timer"


def timer_ms(path: str, classes: Path = CLASSES) -> int | None:
    """Return the latency timer now [ms]; None: the system knows none for this adapter."""
    try:
        return int(timer_file(path, classes).read_text())
    except (OSError, ValueError):
        return None


def set_timer_to_1_ms(path: str, classes: Path = CLASSES) -> bool:
    """Write an adapter's timer; return whether this user may."""
    try:
        timer_file(path, classes).write_text("1")
    except OSError:
        return False
    return True
