"""The sources of the dead man, a switch that must be held: key or pedal, touched file, or page.

A source returns the instant until which the dead man counts as held, on the system's monotonic
clock. The loop compares that instant with its own time in every tick. A silent source and a dead
watcher therefore act as a release.
"""

from __future__ import annotations

import array
import errno
import fcntl
import os
import stat
import struct
from dataclasses import dataclass
from pathlib import Path
from typing import Literal, Protocol

from haptic_wall.controller.errors import UserError

KEY_NS = 45_000_000
"""How long a key counts as held after its state was last read [ns]: even if the watcher stalls or
dies, the torque is off within 50 ms of a release"""
SILENCE_NS = 150_000_000
"""How long a file counts as held after its last change, or a page after the beat that it answered
[ns]"""
PAGE = "page"
"""Name of the page as a source"""

EVENT = struct.Struct("@llHHi")
"""The kernel's input_event: seconds, microseconds, type, code, value.
Source: linux/input.h."""
_EV_SYN, _EV_KEY = 0, 1
_SYN_DROPPED = 3
_KEY_BYTES = 96
"""Bytes of the state of all keys: KEY_MAX is 0x2ff"""
_AT_ONCE = 64
"""Number of events read at a time"""


def _ioctl_read(number: int, size: int) -> int:
    """Return the request that reads ``size`` bytes from an input device (asm-generic/ioctl.h)."""
    return (2 << 30) | (size << 16) | (ord("E") << 8) | number


_EVIOCGVERSION = _ioctl_read(0x01, 4)
_EVIOCGKEY = _ioctl_read(0x18, _KEY_BYTES)
_EVIOCGBIT_KEY = _ioctl_read(0x20 + _EV_KEY, _KEY_BYTES)

KEYS = {
    "KEY_ESC": 1,
    "KEY_ENTER": 28,
    "KEY_LEFTCTRL": 29,
    "KEY_A": 30,
    "KEY_LEFTSHIFT": 42,
    "KEY_C": 46,
    "KEY_B": 48,
    "KEY_RIGHTSHIFT": 54,
    "KEY_LEFTALT": 56,
    "KEY_SPACE": 57,
    "KEY_F12": 88,
    "KEY_RIGHTCTRL": 97,
    "KEY_RIGHTALT": 100,
    "KEY_F13": 183,
    "BTN_0": 256,
    "BTN_LEFT": 272,
    "BTN_RIGHT": 273,
    "BTN_MIDDLE": 274,
    "BTN_TRIGGER": 288,
    "BTN_SOUTH": 304,
}
"""Codes of keys that pedals and keyboards have; other keys are given as numbers. Source:
linux/input-event-codes.h."""


class Source(Protocol):
    """Gives the state of the dead man."""

    descriptor: int | None
    """Becomes readable when there is news; None: the source must be polled"""

    def until(self, now_ns: int, wall_ns: int) -> int:
        """Return until when the dead man counts as held [ns]; 0: it is released.

        Args:
            now_ns: The present time on the monotonic clock [ns].
            wall_ns: The present time on the clock of file time stamps [ns].

        Raises:
            OSError: The source is gone.
        """
        ...


class KeySource:
    """Reads a key, or any key, of an input device, from the kernel's events.

    Args:
        descriptor: Descriptor of the device, readable.
        key: Its code; None: any key of the device.
    """

    __slots__ = ("_key", "_pressed", "_rest", "descriptor")

    descriptor: int | None

    def __init__(self, descriptor: int, key: int | None) -> None:
        self.descriptor = descriptor
        os.set_blocking(descriptor, False)  # for a pipe in tests; a device is already non-blocking
        self._key = key
        self._rest = b""
        self._pressed = self._held_now()

    def until(self, now_ns: int, wall_ns: int) -> int:  # noqa: ARG002 - events have no age here
        """Return until when the key counts as held [ns]; see ``Source``."""
        assert self.descriptor is not None
        while True:
            try:
                found = os.read(self.descriptor, _AT_ONCE * EVENT.size)
            except BlockingIOError:
                break
            if not found:
                raise OSError(errno.ENODEV, os.strerror(errno.ENODEV))
            self._take(found)
        return now_ns + KEY_NS if self._pressed else 0

    def _take(self, found: bytes) -> None:
        """Process events; the last one may come in two parts."""
        whole = self._rest + found
        end = len(whole) - len(whole) % EVENT.size
        self._rest = whole[end:]
        for _, _, kind, code, value in EVENT.iter_unpack(whole[:end]):
            if kind == _EV_SYN and code == _SYN_DROPPED:
                self._pressed = self._held_now()  # events were lost: read the state itself
            elif kind == _EV_KEY and self._key in (None, code):
                if value:  # 1: pressed; 2: repeat
                    self._pressed.add(code)
                else:
                    self._pressed.discard(code)

    def _held_now(self) -> set[int]:
        """Return the held keys from the kernel; none if it does not answer."""
        assert self.descriptor is not None
        try:
            held = _codes(self.descriptor, _EVIOCGKEY)
        except OSError:
            return set()
        return {code for code in held if self._key in (None, code)}


class FileSource:
    """Watches a file that is touched repeatedly: each change renews the hold.

    A change is a new time stamp, size or identity. The existence of the file is not enough: the
    first look only records its state.

    Args:
        path: The file.
        now_ns: The present time on the monotonic clock [ns].
    """

    __slots__ = ("_looked_ns", "_path", "_seen", "_until_ns", "descriptor")

    descriptor: int | None

    def __init__(self, path: str, now_ns: int) -> None:
        self.descriptor = None
        self._path = Path(path)
        self._seen = self._look()
        self._looked_ns = now_ns
        self._until_ns = 0

    def until(self, now_ns: int, wall_ns: int) -> int:
        """Return until when the file counts as renewed [ns]; see ``Source``."""
        found = self._look()
        # A missing file may be in the middle of a replacement: the next file is a renewal.
        if found is not None and found != self._seen:
            self._seen = found
            # The renewal was after the last look, and no later than the file's time stamp.
            renewed_ns = max(self._looked_ns, now_ns - max(0, wall_ns - found[0]))
            self._until_ns = renewed_ns + SILENCE_NS
        self._looked_ns = now_ns
        return self._until_ns

    def _look(self) -> tuple[int, int, int] | None:
        try:
            found = self._path.stat()
        except FileNotFoundError:
            return None
        if not stat.S_ISREG(found.st_mode):
            return None  # something else, such as a folder, is no renewal
        return found.st_mtime_ns, found.st_size, found.st_ino


@dataclass(frozen=True, slots=True)
class Hold:
    """The checked settings of the dead man."""

    path: str
    kind: Literal["key", "file", "page"]
    key: int | None = None
    """Code of the key; None: any key of the device, or a file"""

    def open(self) -> int | None:
        """Open the device; None: the source is a file, which is read by its path, or a page.

        Raises:
            UserError: It cannot be opened any more.
        """
        if self.kind != "key":
            return None
        try:
            return os.open(self.path, os.O_RDONLY | os.O_NONBLOCK | os.O_CLOEXEC)
        except OSError as error:
            raise _unusable(self.path, error) from error


def source_of(hold: Hold, descriptor: int | None, now_ns: int) -> Source:
    """Return the source that ``hold`` names.

    Args:
        hold: The settings.
        descriptor: Descriptor of its device, from ``open``; None: a file.
        now_ns: The present time on the monotonic clock [ns].
    """
    if descriptor is None:
        return FileSource(hold.path, now_ns)
    return KeySource(descriptor, hold.key)


def hold_by(text: str) -> Hold:
    """Return the dead man that ``text`` names: PATH or PATH:KEY of an input device, or a file.

    Raises:
        UserError: It does not exist, cannot be read, or cannot serve as a dead man.
    """
    path, key = text, None
    if not Path(text).exists() and ":" in text:
        path, _, name = text.rpartition(":")
        key = _code(name)
    try:
        mode = Path(path).stat().st_mode
        descriptor = os.open(path, os.O_RDONLY | os.O_NONBLOCK | os.O_CLOEXEC | os.O_NOCTTY)
    except (OSError, ValueError) as error:
        raise _unusable(path, error) from error
    try:
        if stat.S_ISREG(mode):
            if key is not None:
                raise UserError(
                    f"{path} is a file and has no keys", field="--hold", advice="leave :KEY out"
                )
            return Hold(path, "file")
        return _device(path, descriptor, key)
    finally:
        os.close(descriptor)


def _device(path: str, descriptor: int, key: int | None) -> Hold:
    """Return the settings for an input device with keys."""
    if os.isatty(descriptor):
        raise UserError(
            f"{path} is a terminal, which does not report the release of a key",
            field="--hold",
            advice="name an input device such as /dev/input/event3",
        )
    try:
        fcntl.ioctl(descriptor, _EVIOCGVERSION, bytes(4))
        known = _codes(descriptor, _EVIOCGBIT_KEY)
    except OSError:
        raise UserError(
            f"{path} is neither an input device nor a file",
            field="--hold",
            advice="name an input device such as /dev/input/event3, or a file that "
            "a program renews",
        ) from None
    if not known or (key is not None and key not in known):
        what = "no key" if key is None else f"no key {key}"
        raise UserError(
            f"the device {path} has {what}", field="--hold", advice="name another device or key"
        )
    return Hold(path, "key", key)


def _codes(descriptor: int, request: int) -> set[int]:
    """Return the codes of the bits that a bit-field request sets."""
    bits = array.array("B", bytes(_KEY_BYTES))
    fcntl.ioctl(descriptor, request, bits)
    return {8 * n + k for n, byte in enumerate(bits) if byte for k in range(8) if byte >> k & 1}


def _code(name: str) -> int:
    code = KEYS.get(name.upper(), -1)
    if name.isascii() and name.isdigit():
        code = int(name)
    if not 0 <= code < 8 * _KEY_BYTES:
        raise UserError(
            f"found the key {name!r}",
            field="--hold",
            wanted=f"its code as a number, or one of {', '.join(KEYS)}",
        )
    return code


def _unusable(path: str, error: Exception) -> UserError:
    reason = error.strerror if isinstance(error, OSError) else error
    denied = isinstance(error, PermissionError)
    hint = "; devices under /dev/input are open to members of the group input" if denied else ""
    return UserError(
        f"{path} cannot be opened ({reason}){hint}",
        field="--hold",
        advice="name an input device such as /dev/input/event3, or an existing file that "
        "a program renews",
    )
