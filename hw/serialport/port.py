"""Opens a serial port exclusively and at the right rate, or explains why it cannot.

The process that opens the port need not be the one that drives the servo: the descriptor from
``open_port`` can be passed to another process.
"""

from __future__ import annotations

import errno
import fcntl
import os
import stat
import struct
import termios
import time
from contextlib import suppress
from pathlib import Path
from typing import Final

import serial

from haptic_wall.hw.clock import ready
from haptic_wall.hw.errors import BaudRefusedError, PortBusyError, PortError
from haptic_wall.hw.serialport.users import holders, is_terminal

_TCGETS2: Final = 0x802C542A
_TERMIOS2: Final = struct.Struct("=4IB19s2I")


def open_port(path: str, baud: int) -> int:
    """Open a serial port for this process alone: 8N1, raw, low latency, drained.

    The lock is advisory and the kernel's (flock): it ends with the last descriptor, so that a crash
    leaves no lock.

    Args:
        path: The device, e.g. ``/dev/ttyUSB0``.
        baud: Bits per second; any rate that the adapter supports.

    Returns:
        A non-blocking descriptor, not inherited by started programs.

    Raises:
        PortError: No such device, not a serial port, not permitted, or the baud rate refused.
        PortBusyError: Another program has the port.
    """
    device = device_number(path)
    users = list(holders(device))  # before opening and configuring, which would disturb its user
    if users and is_terminal(device):
        pid, program = users[0]
        raise PortBusyError(
            f"Port {path} is used by {program} (pid {pid})", advice="end that program first."
        )
    try:
        port = serial.Serial(
            path,
            baud,
            bytesize=serial.EIGHTBITS,
            parity=serial.PARITY_NONE,
            stopbits=serial.STOPBITS_ONE,
            timeout=0,
            exclusive=True,
        )
    except termios.error as error:
        if error.args[0] != errno.EINVAL:  # it has disappeared since it was opened
            raise open_error(path, OSError(*error.args)) from error
        raise _baud_error(f"Port {path} refuses {baud} baud ({error})") from error
    except ValueError as error:
        raise _baud_error(f"Port {path} refuses {baud} baud ({error})") from error
    except OSError as error:
        raise open_error(path, error) from error
    try:
        with suppress(ValueError, OSError):  # FTDI adapters otherwise hold a short reply for 16 ms
            port.set_low_latency_mode(True)
        descriptor = os.dup(port.fileno())
    finally:
        port.close()
    try:
        _wait_with_a_read_for_bytes(descriptor)
        _drain(descriptor)
    except termios.error as error:
        os.close(descriptor)
        raise open_error(path, OSError(*error.args)) from error
    except BaseException:
        os.close(descriptor)
        raise
    return descriptor


def device_number(path: str) -> int:
    """Return the device's number.

    Raises:
        PortError: There is none, or it is no device.
    """
    try:
        found = Path(path).stat()
    except OSError as error:
        raise open_error(path, error) from error
    if not stat.S_ISCHR(found.st_mode):
        raise not_serial(path)
    return found.st_rdev


def _baud_error(what: str) -> BaudRefusedError:
    return BaudRefusedError(
        what,
        advice="set servo.baud and the servo's Baud Rate (8) to a rate this adapter has.",
    )


def open_error(path: str, error: OSError) -> PortError:
    """Return the explanation of a port that could not be opened."""
    code = error.errno
    if code in (errno.ENOENT, errno.ENODEV, errno.ENXIO, errno.ENOTDIR):
        return PortError(
            f"Port {path} does not exist (there is {_candidates()})",
            advice="plug the adapter in, name another port with its whole path, or start an "
            f"emulated bus there (`haptic-wall emulate --link {path}`).",
        )
    if code in (errno.EACCES, errno.EPERM):
        return PortError(
            f"Port {path} may not be used by this user", advice=f"{access_remedy(path)}."
        )
    if code in (errno.EBUSY, errno.EAGAIN):
        return PortBusyError(
            f"Port {path} is locked by another program",
            advice=f"end that program first (`sudo fuser {path}` names it).",
        )
    if code is None:  # pyserial's own message, e.g. for a device file without a device
        return not_serial(path, f" ({error})")
    return PortError(f"Port {path} cannot be opened ({error})", advice="check the adapter.")


def not_serial(path: str, why: str = "") -> PortError:
    """Return the error for a path that is no serial port."""
    advice = f"name the adapter's device, e.g. /dev/ttyUSB0{why}."
    return PortError(f"Port {path} is not a serial port", advice=advice)


def _candidates() -> str:
    by_id = Path("/dev/serial/by-id")
    found = sorted(str(p) for p in by_id.iterdir()) if by_id.is_dir() else []
    found = found or sorted(
        str(p) for kind in ("ttyUSB*", "ttyACM*") for p in Path("/dev").glob(kind)
    )
    return ", ".join(found) or "no serial adapter"


def access_remedy(path: str) -> str:
    """Name the remedy that grants access: the group that owns the device, if it may read and write.

    Args:
        path: A device that exists.
    """
    import grp

    found = Path(path).stat()
    try:
        group = grp.getgrgid(found.st_gid).gr_name
    except KeyError:
        group = "root"
    if group == "root" or stat.S_IMODE(found.st_mode) & 0o060 != 0o060:
        return f"allow it with `sudo chmod a+rw {path}`"
    return f"join the group {group} with `sudo usermod -aG {group} $USER` and log in again"


def baud_of(descriptor: int) -> int | None:
    """Return the baud rate of a terminal, also a non-standard one [bit/s].

    None: this kernel numbers the request differently.
    """
    try:
        found = fcntl.ioctl(descriptor, _TCGETS2, bytes(_TERMIOS2.size))
    except OSError:
        return None
    return int(_TERMIOS2.unpack(found)[-1])


def _wait_with_a_read_for_bytes(descriptor: int) -> None:
    """Set VMIN 1, so that an empty read only means that the port has hung up."""
    settings = termios.tcgetattr(descriptor)
    settings[6][termios.VMIN] = 1
    settings[6][termios.VTIME] = 0
    termios.tcsetattr(descriptor, termios.TCSANOW, settings)


def _drain(descriptor: int) -> None:
    """Discard bytes for the port's former user, until it is quiet."""
    termios.tcflush(descriptor, termios.TCIOFLUSH)
    end = time.monotonic() + 0.3  # a change of the latency timer may delay bytes for 250 ms
    while time.monotonic() < end and ready((descriptor,), 0.003):
        try:
            if not os.read(descriptor, 4096):
                return
        except OSError:
            return
