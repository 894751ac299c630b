"""The dead man's sources: a key or pedal of an input device, or a file that something renews.

A source says until when the dead man counts as held, on the system's monotonic clock. The loop
compares that instant with its own time in every tick, so a source that is silent, and a watcher
that has died, are a release.
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
"""How long a key counts as held after its state was last looked at [ns]: where the watcher stalls
or dies, torque is out within 50 ms of a release all the same"""
SILENCE_NS = 150_000_000
"""How long a file counts as held after it was last renewed [ns]"""

EVENT = struct.Struct("@llHHi")
"""The kernel's input_event: seconds, microseconds, type, code, value.
Source: linux/input.h."""
_EV_SYN, _EV_KEY = 0, 1
_SYN_DROPPED = 3
_KEY_BYTES = 96
"""Bytes for the state of all keys: KEY_MAX is 0x2ff"""
_AT_ONCE = 64
"""Events read at a time"""


def _ioctl_read(number: int, size: int) -> int:
    """The request that reads ``size`` bytes from an input device. Source: asm-generic/ioctl.h."""
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
"""Codes of keys that pedals and keyboards have; others are given as numbers.
Source: linux/input-event-codes.h."""


class Source(Protocol):
    """Where the dead man's state comes from."""

    descriptor: int | None
    """Becomes readable when there is news; None: it must be looked at again and again"""

    def until(self, now_ns: int, wall_ns: int) -> int:
        """Until when the dead man counts as held [ns]; 0: it is released.

        Args:
            now_ns: The present time on the monotonic clock [ns].
            wall_ns: The same on the clock that files are stamped by [ns].

        Raises:
            OSError: The source is gone.
        """
        ...


class KeySource:
    """A key, or any key, of an input device, from the kernel's events.

    Args:
        descriptor: Of the device, readable.
        key: Its code; None: any key of the device.
    """

    __slots__ = ("_key", "_pressed", "_rest", "descriptor")

    descriptor: int | None

    def __init__(self, descriptor: int, key: int | None) -> None:
        self.descriptor = descriptor
        os.set_blocking(descriptor, False)  # of a pipe in tests; a device is opened so
        self._key = key
        self._rest = b""
        self._pressed = self._held_now()

    def until(self, now_ns: int, wall_ns: int) -> int:  # noqa: ARG002 - events have no age here
        """See ``Source``."""
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
        """Take events, the last of which may come in two parts."""
        whole = self._rest + found
        end = len(whole) - len(whole) % EVENT.size
        self._rest = whole[end:]
        for _, _, kind, code, value in EVENT.iter_unpack(whole[:end]):
            if kind == _EV_SYN and code == _SYN_DROPPED:
                self._pressed = self._held_now()  # events were lost: ask for the state itself
            elif kind == _EV_KEY and self._key in (None, code):
                if value:  # 1: pressed; 2: repeated while it is held
                    self._pressed.add(code)
                else:
                    self._pressed.discard(code)

    def _held_now(self) -> set[int]:
        """The keys that are held, as the kernel says; none where it says nothing."""
        assert self.descriptor is not None
        try:
            held = _codes(self.descriptor, _EVIOCGKEY)
        except OSError:
            return set()
        return {code for code in held if self._key in (None, code)}


class FileSource:
    """A file that something renews: each change of its time stamp, size or identity is one.

    That the file exists is not enough: the first look only learns what it is like.

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
        """See ``Source``."""
        found = self._look()
        # A file that is gone for a moment is being replaced: the next one that comes is a renewal.
        if found is not None and found != self._seen:
            self._seen = found
            # Since the last look, and no later than its stamp says.
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
            return None  # what stands in its place, a folder for instance, renews nothing
        return found.st_mtime_ns, found.st_size, found.st_ino


@dataclass(frozen=True, slots=True)
class Hold:
    """Settings of the dead man, checked."""

    path: str
    kind: Literal["key", "file"]
    key: int | None = None
    """Code of the key; None: any key of the device, or a file"""

    def open(self) -> int | None:
        """Open the device; None: a file, which is looked at by its path.

        Raises:
            UserError: It cannot be opened any more.
        """
        if self.kind == "file":
            return None
        try:
            return os.open(self.path, os.O_RDONLY | os.O_NONBLOCK | os.O_CLOEXEC)
        except OSError as error:
            raise _unusable(self.path, error) from error


def source_of(hold: Hold, descriptor: int | None, now_ns: int) -> Source:
    """The source that ``hold`` names.

    Args:
        hold: What it is to be.
        descriptor: Of its device, as ``open`` gives it; None: a file.
        now_ns: The present time on the monotonic clock [ns].
    """
    if descriptor is None:
        return FileSource(hold.path, now_ns)
    return KeySource(descriptor, hold.key)


def hold_by(text: str) -> Hold:
    """The dead man that ``text`` names: PATH or PATH:KEY of an input device, or a file.

    Raises:
        UserError: There is no such thing, it cannot be read, or it is nothing that can be held.
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
                raise UserError(f"--hold: {path} is a file and has no keys; leave :KEY out")
            return Hold(path, "file")
        return _device(path, descriptor, key)
    finally:
        os.close(descriptor)


def _device(path: str, descriptor: int, key: int | None) -> Hold:
    """An input device with keys."""
    if os.isatty(descriptor):
        raise UserError(
            f"--hold: {path} is a terminal, which does not say when a key is let go; name an input"
            " device such as /dev/input/event3"
        )
    try:
        fcntl.ioctl(descriptor, _EVIOCGVERSION, bytes(4))
        known = _codes(descriptor, _EVIOCGBIT_KEY)
    except OSError:
        raise UserError(
            f"--hold: {path} is neither an input device nor a file; name an input device such as"
            " /dev/input/event3, or a file that something renews"
        ) from None
    if not known or (key is not None and key not in known):
        what = "no key" if key is None else f"no key {key}"
        raise UserError(f"--hold: the device {path} has {what}; name another device or key")
    return Hold(path, "key", key)


def _codes(descriptor: int, request: int) -> set[int]:
    """The codes whose bits a request for a bit field gives."""
    bits = array.array("B", bytes(_KEY_BYTES))
    fcntl.ioctl(descriptor, request, bits)
    return {8 * n + k for n, byte in enumerate(bits) if byte for k in range(8) if byte >> k & 1}


def _code(name: str) -> int:
    code = KEYS.get(name.upper(), -1)
    if name.isascii() and name.isdigit():
        code = int(name)
    if not 0 <= code < 8 * _KEY_BYTES:
        raise UserError(
            f"--hold: found the key {name!r}, wanted its code as a number, or one of"
            f" {', '.join(KEYS)}"
        )
    return code


def _unusable(path: str, error: Exception) -> UserError:
    reason = error.strerror if isinstance(error, OSError) else error
    denied = isinstance(error, PermissionError)
    hint = "; the devices under /dev/input want the group input" if denied else ""
    return UserError(
        f"--hold: {path} cannot be opened ({reason}){hint}; name an input device such as"
        " /dev/input/event3, or a file that exists and that something renews"
    )
