"""Finds the serial adapters of this machine, and their kind, user and latency.

All information comes from Linux, in ``/sys`` and ``/proc``. Nothing is sent.
"""

from __future__ import annotations

import os
import stat
from collections.abc import Iterable
from pathlib import Path
from typing import Final, NamedTuple

from serial.tools import list_ports

from haptic_wall.controller.doctor.report import not_applicable, of_error
from haptic_wall.hw.errors import PortError
from haptic_wall.hw.serialport.port import device_number, not_serial, open_error
from haptic_wall.hw.serialport.users import holders, is_pseudo, is_terminal
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
    found = [
        Adapter(port.device, kind_of(port.vid, port.pid, port.description))
        for port in list_ports.comports()
        if port.vid is not None
    ]
    return sorted(found)


def only_adapter(found: Iterable[Adapter] | None = None) -> str:
    """Return the device of the only adapter.

    Args:
        found: The adapters to choose from; None: those of this machine.

    Raises:
        PortError: There is none, or more than one; the message lists them.
    """
    candidates = adapters() if found is None else list(found)
    if not candidates:
        raise PortError(
            "No USB serial adapter is plugged in",
            advice="plug it in, or name the port with --port (an on-board one is e.g. "
            "/dev/ttyAMA0, an emulated bus prints its path).",
        )
    if len(candidates) > 1:
        listed = "; ".join(map(str, candidates))
        raise PortError(
            f"{len(candidates)} serial adapters are plugged in, one is wanted",
            advice=f"choose with --port. {listed}.",
        )
    return candidates[0].device


def kind_of(vid: int | None, pid: int | None, description: str) -> str:
    """Name the kind of an adapter, from its USB ids (None: it is not on USB) and its own name."""
    if vid is None or pid is None:
        return "a serial port that is not on USB"
    return f"{description}, {vid:04x}:{pid:04x}"


def kind_of_port(path: str) -> str:
    """Name the kind of the adapter behind a device path, links followed."""
    device = os.path.realpath(path)
    if is_pseudo_terminal(path):
        return PSEUDO
    for port in list_ports.comports():
        if os.path.realpath(port.device) == device:
            return kind_of(port.vid, port.pid, port.description)
    return kind_of(None, None, "")


def is_pseudo_terminal(path: str) -> bool:
    """Whether a path leads to a pseudo-terminal; False if it leads nowhere."""
    try:
        found = Path(path).stat()
    except OSError:
        return False
    return stat.S_ISCHR(found.st_mode) and is_pseudo(found.st_rdev)


def may_be_serial(path: str) -> bool:
    """Whether a path leads to a terminal, or nowhere yet; the port is not opened."""
    try:
        found = Path(path).stat()
    except OSError:
        return True
    return stat.S_ISCHR(found.st_mode) and is_terminal(found.st_rdev)


def examine_port(path: str) -> list[Check]:
    """Check whether a port exists, is permitted and free, and its kind; stop at the first fault.

    The port is opened briefly, without changing its settings, and nothing is sent; a port in use is
    not opened.

    Args:
        path: The device, e.g. ``/dev/ttyUSB0``.
    """
    try:
        device = device_number(path)
    except PortError as error:
        return [of_error("port", error, "a serial device", "set servo.port")]
    real = os.path.realpath(path)
    checks = [Check("port", True, path if real == path else f"{path} -> {real}", "a device")]
    users = [f"{program} (pid {pid})" for pid, program in holders(device)]
    fix = f"end that program (`sudo fuser -v {path}` shows it)" if users else ""
    used_by = Check("used by", not users, ", ".join(users) or "nobody", "nobody", fix)
    if users and is_terminal(device):
        return [*checks, used_by]  # opening it would disturb a wall in use there
    rights = "reading and writing"
    try:
        descriptor = os.open(path, os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK)
        terminal = os.isatty(descriptor)
        os.close(descriptor)
    except OSError as error:
        return [*checks, of_error("rights", open_error(path, error), rights, "check the adapter")]
    if not terminal:
        return [*checks, of_error("rights", not_serial(path), "a serial port", "set servo.port")]
    adapter = Check("adapter", True, kind_of_port(path), "a serial adapter")
    return [*checks, Check("rights", True, rights, rights), adapter, used_by]


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
    if is_pseudo_terminal(path):
        why = "a pseudo-terminal has no such setting; the reply time is measured below"
        return not_applicable(name, why)
    timer = classes / Path(path).resolve().name / "device" / "latency_timer"
    try:
        latency_ms = int(timer.read_text())
    except (OSError, ValueError):
        return not_applicable(name, "the adapter's driver has no such timer")
    fix = "" if latency_ms <= 1 else f"`echo 1 | sudo tee {timer}` (until it is unplugged)"
    return Check(name, latency_ms <= 1, f"{latency_ms} ms", "1 ms", fix)
