"""Finds the serial adapters of this machine, and their kind, user and latency.

All information comes from Linux, in ``/sys`` and ``/proc``. Nothing is sent.
"""

from __future__ import annotations

import os
import stat
from collections.abc import Iterable, Mapping
from pathlib import Path
from types import MappingProxyType
from typing import Final, NamedTuple

from serial.tools import list_ports

from haptic_wall.controller.doctor.report import not_applicable, of_error
from haptic_wall.hw.errors import PortError
from haptic_wall.hw.serialport.port import device_number, not_serial, open_error
from haptic_wall.hw.serialport.timer import CLASSES, describe, timer_file, timer_ms
from haptic_wall.hw.serialport.users import holders, is_pseudo, is_terminal
from haptic_wall.hw.servo import Check

PSEUDO: Final = "a pseudo-terminal (an emulated bus)"

# Source: the USB ID repository (usb-ids.org); for the OpenRB its maker's board definition.
_KINDS: Final[Mapping[tuple[int, int], str]] = MappingProxyType(
    {
        (0x0403, 0x6014): "FTDI FT232H (U2D2 and others; high-speed, has a latency timer)",
        (0x0403, 0x6001): "FTDI FT232R (USB2Dynamixel and others; full-speed, has a latency timer)",
        (0x0403, 0x6010): "FTDI FT2232 (high-speed, has a latency timer)",
        (0x0403, 0x6011): "FTDI FT4232 (high-speed, has a latency timer)",
        (0x0403, 0x6015): "FTDI FT230X/FT231X (full-speed, has a latency timer)",
        (0x2F5D, 0x2202): "ROBOTIS OpenRB (no latency timer)",
        (0x0483, 0x5740): "STM32 virtual port (OpenCR and others; no latency timer)",
        (0x1A86, 0x7523): "WCH CH340 (no latency timer; up to 2 Mbit/s)",
        (0x1A86, 0x55D3): "WCH CH343 (no latency timer)",
        (0x10C4, 0xEA60): "Silicon Labs CP210x (no latency timer; up to 1 or 3 Mbit/s)",
    }
)
_MAKERS: Final[Mapping[int, str]] = MappingProxyType(
    {
        0x2F5D: "ROBOTIS",
        0x0403: "FTDI (has a latency timer)",
        0x1A86: "WCH",
        0x10C4: "Silicon Labs",
    }
)


class Adapter(NamedTuple):
    """A connected serial adapter."""

    device: str
    kind: str
    """For people: maker and part, or the device's own name"""

    def __str__(self) -> str:
        return f"{self.device}: {self.kind}"


def adapters() -> list[Adapter]:
    """Return the USB serial adapters of this machine by device path, in order."""
    found = [
        Adapter(port.device, kind_of(port.vid, port.pid, port.product))
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


def kind_of(vid: int | None, pid: int | None, product: str | None) -> str:
    """Name the kind of an adapter, from its USB ids and its own name for itself.

    Args:
        vid: USB vendor id; None: not a USB device.
        pid: USB product id.
        product: The product's name as the device gives it.
    """
    if vid is None or pid is None:
        return product or "a serial port that is not on USB"
    ids = f"{vid:04x}:{pid:04x}"
    kind = _KINDS.get((vid, pid)) or _MAKERS.get(vid) or "unknown to this program"
    return f"{kind}, {ids}" + (f", calls itself {product}" if product else "")


def kind_of_port(path: str) -> str:
    """Name the kind of the adapter behind a device path, links followed."""
    device = os.path.realpath(path)
    if is_pseudo_terminal(path):
        return PSEUDO
    for port in list_ports.comports():
        if os.path.realpath(port.device) == device:
            return kind_of(port.vid, port.pid, port.product)
    return kind_of(None, None, None)


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

    Args:
        path: The port.
        classes: Where Linux lists serial ports.
    """
    name = "latency timer"
    if is_pseudo_terminal(path):
        why = "a pseudo-terminal has no such setting; the reply time is measured below"
        return not_applicable(name, why)
    latency_ms, found = timer_ms(path, classes), describe(path, classes)
    if latency_ms is None:
        return not_applicable(name, f"the adapter's driver has no such timer ({found})")
    timer, wanted = timer_file(path, classes), "1 ms"
    if latency_ms == 0:
        fix = (
            "with 0 some U2D2 are reported to find no servos; if yours finds none, "
            f"`echo 1 | sudo tee {timer}`"
        )
        return Check(name, True, found, wanted, fix)
    fix = "" if latency_ms == 1 else f"`echo 1 | sudo tee {timer}` (until it is unplugged)"
    return Check(name, latency_ms == 1, found, wanted, fix)
