"""Finds the serial adapters of this machine, and their kind and latency.

All information comes from Linux, in ``/sys`` and ``/proc``. Nothing is sent.
"""

from __future__ import annotations

import os
import stat
from collections.abc import Sequence
from pathlib import Path
from typing import Final, NamedTuple

from serial.tools import list_ports

from haptic_wall.controller.doctor.report import not_applicable
from haptic_wall.hw.errors import PortError, is_emulated
from haptic_wall.hw.serialport.users import is_terminal
from haptic_wall.hw.servo import Check

CLASSES: Final = Path("/sys/class/tty")
PSEUDO: Final = "a pseudo-terminal (an emulated bus)"


class Adapter(NamedTuple):
    """A connected serial adapter."""

    device: str
    kind: str
    """For people: USB ids, and the device's own name"""

    def __str__(self) -> str:
        return f"{self.device}: {self.kind}"


def adapters() -> list[Adapter]:
    """Return the USB serial adapters of this machine by device path, in order."""
    return sorted(
        Adapter(port.device, f"{port.description}, {port.vid:04x}:{port.pid:04x}")
        for port in list_ports.comports()
        if port.vid is not None
    )


def only_adapter(found: Sequence[Adapter]) -> str:
    """Return the device of the only adapter.

    Raises:
        PortError: There is none, or more than one; the message lists them.
    """
    if not found:
        raise PortError(
            "No USB serial adapter is plugged in",
            advice="plug it in, or name the port with --port (an on-board one is e.g. "
            "/dev/ttyAMA0, an emulated bus prints its path).",
        )
    if len(found) > 1:
        listed = "; ".join(map(str, found))
        raise PortError(
            f"{len(found)} serial adapters are plugged in, one is wanted",
            advice=f"choose with --port. {listed}.",
        )
    return found[0].device


def kind_of_port(path: str) -> str:
    """Name the kind of the adapter behind a device path, links followed."""
    if is_emulated(path):
        return PSEUDO
    device = os.path.realpath(path)
    same = (each.kind for each in adapters() if os.path.realpath(each.device) == device)
    return next(same, "a serial port that is not on USB")


def may_be_serial(path: str) -> bool:
    """Whether a path leads to a terminal, or nowhere yet; the port is not opened."""
    try:
        found = Path(path).stat()
    except OSError:
        return True
    return stat.S_ISCHR(found.st_mode) and is_terminal(found.st_rdev)


def examine_latency_timer(path: str, classes: Path = CLASSES) -> Check:
    """Check how long an FTDI adapter holds short replies; the port is open in low-latency mode.

    That mode, a flag that any user of the port may set, is 1 ms. It is the driver's claim: the real
    time of replies is measured.

    Source: Linux, drivers/usb/serial/ftdi_sio.c, ``latency_timer_show``.

    Args:
        path: The port.
        classes: Where Linux lists serial ports.
    """
    name = "latency timer"
    if is_emulated(path):
        why = "a pseudo-terminal has no such setting; the reply time is measured below"
        return not_applicable(name, why)
    timer = classes / Path(path).resolve().name / "device" / "latency_timer"
    try:
        latency_ms = int(timer.read_text())
    except (OSError, ValueError):
        return not_applicable(name, "the adapter's driver has no such timer")
    fix = "" if latency_ms <= 1 else f"`echo 1 | sudo tee {timer}` (until it is unplugged)"
    return Check(name, latency_ms <= 1, f"{latency_ms} ms", "1 ms", fix)
