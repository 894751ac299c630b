"""The dead man, a switch that must be held: a key or pedal, or a button on the live page.

``Word.HELD_NS`` is the instant until which it counts as held, on the clock of the loop, which looks
at it in every tick. The loop itself reads a key, the page's process writes for
its button. A silent source therefore acts as a release.
"""

from __future__ import annotations

import array
import errno
import fcntl
import math
import os
import struct
from collections.abc import Callable
from dataclasses import dataclass

from haptic_wall.controller.errors import UserError
from haptic_wall.controller.runtime.telemetry import Word

LOOK_NS = 10_000_000
"""Time between two looks at a key [ns]"""
KEY_NS = 45_000_000
"""How long a key counts as held after its state was last read [ns]"""
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
_ADVICE = "name an input device such as /dev/input/event3, or page"


def _ioctl_read(number: int, size: int) -> int:
    """Return the request that reads ``size`` bytes from an input device (asm-generic/ioctl.h)."""
    return (2 << 30) | (size << 16) | (ord("E") << 8) | number


_EVIOCGVERSION = _ioctl_read(0x01, 4)
_EVIOCGKEY = _ioctl_read(0x18, _KEY_BYTES)
_EVIOCGBIT_KEY = _ioctl_read(0x20 + _EV_KEY, _KEY_BYTES)


class KeySource:
    """Reads whether any key of an input device is down, from the kernel's events.

    Args:
        descriptor: Descriptor of the device, readable.
    """

    __slots__ = ("_descriptor", "_pressed")

    def __init__(self, descriptor: int) -> None:
        self._descriptor = descriptor
        os.set_blocking(descriptor, False)  # for a pipe in tests; a device is already non-blocking
        self._pressed = self._held_now()

    def until(self, now_ns: int) -> int:
        """Return until when a key counts as held [ns]; 0: none is down.

        Args:
            now_ns: The present time on the loop's clock [ns].

        Raises:
            OSError: The device is gone.
        """
        while True:
            try:
                found = os.read(self._descriptor, _AT_ONCE * EVENT.size)
            except BlockingIOError:
                break
            if not found:
                raise OSError(errno.ENODEV, os.strerror(errno.ENODEV))
            self._take(found)
        return now_ns + KEY_NS if self._pressed else 0

    def _take(self, found: bytes) -> None:
        """Process events: the kernel gives whole ones."""
        for _, _, kind, code, value in EVENT.iter_unpack(found):
            if kind == _EV_SYN and code == _SYN_DROPPED:
                self._pressed = self._held_now()  # events were lost: read the state itself
            elif kind == _EV_KEY:
                if value:  # 1: pressed; 2: repeat
                    self._pressed.add(code)
                else:
                    self._pressed.discard(code)

    def _held_now(self) -> set[int]:
        """Return the held keys from the kernel; none if it does not answer."""
        try:
            return _codes(self._descriptor, _EVIOCGKEY)
        except OSError:
            return set()


def key_reader(
    source: KeySource, words: memoryview[int], gone: Callable[[OSError], None]
) -> Callable[[int], float]:
    """Return what the loop calls to read a key into ``Word.HELD_NS``.

    It takes the present time, and returns when to look again, both on the loop's clock [ns].

    Args:
        source: The key.
        words: The control words.
        gone: Called when the device is gone; the dead man then stays released.
    """

    def look(now_ns: int) -> float:
        try:
            words[Word.HELD_NS] = source.until(now_ns)
        except OSError as error:
            words[Word.HELD_NS] = 0
            gone(error)
            return math.inf
        return now_ns + LOOK_NS

    return look


@dataclass(frozen=True, slots=True)
class Hold:
    """The checked settings of the dead man."""

    path: str
    """Of an input device, or ``PAGE``"""

    @property
    def is_page(self) -> bool:
        """Whether a page holds it."""
        return self.path == PAGE

    def open(self) -> int | None:
        """Open the device; None: a page holds it.

        Raises:
            UserError: It cannot be opened any more.
        """
        if self.is_page:
            return None
        try:
            return os.open(self.path, os.O_RDONLY | os.O_NONBLOCK | os.O_CLOEXEC)
        except OSError as error:
            raise _unusable(self.path, error) from error


def gone_texts(why: str) -> tuple[str, str]:
    """Return what is told at once of a source that is gone, and what the report notes."""
    return (
        f"--hold: {why}; the wall is off and stays off: end the run with Ctrl-C",
        f"--hold: {why}; from then on the wall was off",
    )


def hold_by(path: str) -> Hold:
    """Return the dead man with the path of an input device.

    Raises:
        UserError: It does not exist, cannot be read, or cannot serve as a dead man.
    """
    if not path.strip():
        raise UserError("found nothing", field="--hold", advice=_ADVICE)
    try:
        descriptor = os.open(path, os.O_RDONLY | os.O_NONBLOCK | os.O_CLOEXEC | os.O_NOCTTY)
    except (OSError, ValueError) as error:
        raise _unusable(path, error) from error
    try:
        if os.isatty(descriptor):
            raise UserError(
                f"{path} is a terminal, which does not report the release of a key",
                field="--hold",
                advice=_ADVICE,
            )
        try:
            fcntl.ioctl(descriptor, _EVIOCGVERSION, bytes(4))
            known = _codes(descriptor, _EVIOCGBIT_KEY)
        except OSError:
            raise UserError(
                f"{path} is not an input device", field="--hold", advice=_ADVICE
            ) from None
    finally:
        os.close(descriptor)
    if not known:
        raise UserError(
            f"the device {path} has no key", field="--hold", advice="name another device"
        )
    return Hold(path)


def _codes(descriptor: int, request: int) -> set[int]:
    """Return the codes of the bits that a bit-field request sets."""
    bits = array.array("B", bytes(_KEY_BYTES))
    fcntl.ioctl(descriptor, request, bits)
    return {8 * n + k for n, byte in enumerate(bits) if byte for k in range(8) if byte >> k & 1}


def _unusable(path: str, error: Exception) -> UserError:
    reason = error.strerror if isinstance(error, OSError) else error
    denied = isinstance(error, PermissionError)
    hint = "; devices under /dev/input are open to members of the group input" if denied else ""
    return UserError(
        f"{path} cannot be opened ({reason}){hint}",
        field="--hold",
        advice=_ADVICE,
    )
