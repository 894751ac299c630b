"""How long an adapter may keep a short reply to itself: the latency timer of FTDI parts.

Their driver in Linux has two settings. The low-latency mode, a flag that whoever may use the port
may set, means 1 ms until the adapter is unplugged: the file in ``/sys`` then says 1, and what is
written into it has no effect. Without the mode the file's number holds. Drivers of other adapters
refuse the flag, or take it and forget it; so a request that succeeds says nothing, and only what is
read back counts. That too is the driver's word: what replies really take is measured.

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
"""Behind type, line, port and irq"""
_ASYNC_LOW_LATENCY: Final = 0x2000


def timer_file(path: str, classes: Path = CLASSES) -> Path:
    """The file that holds the latency timer of the adapter behind a port, if it has one."""
    return classes / Path(path).resolve().name / "device" / "latency_timer"


def timer_ms(path: str, classes: Path = CLASSES) -> int | None:
    """The latency timer now [ms]; None: this adapter has none that the system knows of.

    Args:
        path: The port's device.
        classes: Where the system describes its ports.
    """
    try:
        return int(timer_file(path, classes).read_text())
    except (OSError, ValueError):
        return None


def set_timer_to_1_ms(path: str, classes: Path = CLASSES) -> bool:
    """Write an adapter's timer; whether this user may."""
    try:
        timer_file(path, classes).write_text("1")
    except OSError:
        return False
    return True


def low_latency(path: str, descriptor: int | None = None) -> bool | None:
    """Whether the port's driver is in its low-latency mode, as read back; nothing is set.

    Args:
        path: The port's device.
        descriptor: The port, where it is open already; None: it is opened for a moment. A port
            that is kept to a run cannot be opened again, or the opening looks like a stranger's.

    Returns:
        None: the driver knows no such mode, or the port cannot be opened.
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
    """Describe the timer for people; "none" where nothing says that there is one.

    Args:
        path: The port's device.
        classes: Where the system describes its ports.
        descriptor: The port, where it is open already.
    """
    latency_ms, mode = timer_ms(path, classes), low_latency(path, descriptor)
    if latency_ms is None:
        return "none in /sys, low-latency mode is on" if mode else "none"
    if latency_ms > 1:
        return f"{latency_ms} ms, low-latency mode is {'on' if mode else 'refused'}"
    return f"{latency_ms} ms"
