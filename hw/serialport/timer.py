"""Reads and sets the latency timer of FTDI adapters: how long they may hold a short reply.

Their Linux driver has two settings. The low-latency mode, a flag that any user of the port may set,
means 1 ms until the adapter is unplugged: the file in ``/sys`` then says 1, and writing it has no
effect. Without the mode the file's number applies. Drivers of other adapters refuse the flag, or
accept and forget it; so a successful request proves nothing, and only the value read back counts.
Even that is the driver's claim: the real time of replies is measured.

Source: Linux, drivers/usb/serial/ftdi_sio.c, ``write_latency_timer`` and ``latency_timer_show``.
"""

from __future__ import annotations

import fcntl
import os
import struct
import termios
from pathlib import Path
from typing import Final

CLASSES = Path("/sys/class/tty")
_SERIAL_STRUCT: Final = 128
"""Room for the kernel's ``serial_struct``, on any architecture [bytes]"""
_FLAGS_AT: Final = 16
"""Offset of the flags, after type, line, port and irq"""
_ASYNC_LOW_LATENCY: Final = 0x2000


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


def low_latency(path: str, descriptor: int | None = None) -> bool | None:
    """Whether the port's driver is in its low-latency mode, as read back; sets nothing.

    Args:
        path: The port's device.
        descriptor: The port, where it is already open; None: it is opened briefly. A port that is
            reserved for a run cannot be opened again, or the opening looks like another program's.

    Returns:
        None: the driver has no such mode, or the port cannot be opened.
    """
    opened = None
    try:
        if descriptor is None:
            descriptor = opened = os.open(path, os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK)
        found = fcntl.ioctl(descriptor, termios.TIOCGSERIAL, bytes(_SERIAL_STRUCT))
    except OSError:
        return None
    finally:
        if opened is not None:
            os.close(opened)
    return bool(struct.unpack_from("i", found, _FLAGS_AT)[0] & _ASYNC_LOW_LATENCY)


def describe(path: str, classes: Path = CLASSES, descriptor: int | None = None) -> str:
    """Describe the timer for people; "none" where there is no sign of one.

    Args:
        path: The port's device.
        classes: Where the system describes its ports.
        descriptor: The port, where it is already open.
    """
    latency_ms, mode = timer_ms(path, classes), low_latency(path, descriptor)
    if latency_ms is None:
        return "none in /sys, low-latency mode is on" if mode else "none"
    if latency_ms > 1:
        return f"{latency_ms} ms, low-latency mode is {'on' if mode else 'refused'}"
    return f"{latency_ms} ms"
