"""The dead man, a switch that must be held: a key or pedal, or a button on the live page.

``Word.HELD_NS`` is the instant until which it counts as held, on the clock of the loop, which looks
at it in every tick. The loop itself reads a key, the page's process writes for its button. A silent
source therefore acts as a release.
"""

from __future__ import annotations

import fcntl
import math
import os
from collections.abc import Callable

from haptic_wall.controller.errors import UserError
from haptic_wall.controller.runtime.telemetry import Word

LOOK_NS = 10_000_000
"""Time between two looks at a key [ns]"""
KEY_NS = 45_000_000
"""How long a key counts as held after its state was last read [ns]"""
PAGE = "page"
"""Name of the page as a source"""

_EV_KEY = 1
_KEY_BYTES = 96
"""Bytes of the state of all keys: KEY_MAX is 0x2ff"""
_ADVICE = "name an input device such as /dev/input/event3, or page"


def _ioctl_read(number: int, size: int) -> int:
    """Return the request that reads ``size`` bytes from an input device (asm-generic/ioctl.h)."""
    return (2 << 30) | (size << 16) | (ord("E") << 8) | number


_EVIOCGKEY = _ioctl_read(0x18, _KEY_BYTES)
_EVIOCGBIT_KEY = _ioctl_read(0x20 + _EV_KEY, _KEY_BYTES)


def key_reader(
    descriptor: int, words: memoryview[int], gone: Callable[[OSError], None]
) -> Callable[[int], float]:
    """Return what the loop calls to read a key into ``Word.HELD_NS``: any key that is down.

    It takes the present time, and returns when to look again, both on the loop's clock [ns].

    Args:
        descriptor: Descriptor of the device, readable.
        words: The control words.
        gone: Called when the device is gone; the dead man then stays released.
    """

    def look(now_ns: int) -> float:
        try:
            words[Word.HELD_NS] = now_ns + KEY_NS if _has_any(descriptor, _EVIOCGKEY) else 0
        except OSError as error:
            words[Word.HELD_NS] = 0
            gone(error)
            return math.inf
        return now_ns + LOOK_NS

    return look


def gone_text(why: str) -> str:
    """Return what a person and the report are told of a source that is gone."""
    return f"--hold: {why}; the wall stays off until the run ends"


def opened(path: str) -> int:
    """Open an input device to read its keys; return its descriptor.

    Raises:
        UserError: It does not exist, cannot be read, or has no keys.
    """
    if not path.strip():
        raise UserError("found nothing", field="--hold", advice=_ADVICE)
    try:
        descriptor = os.open(path, os.O_RDONLY | os.O_NONBLOCK | os.O_CLOEXEC | os.O_NOCTTY)
    except (OSError, ValueError) as error:
        reason = error.strerror if isinstance(error, OSError) else error
        denied = isinstance(error, PermissionError)
        hint = "; devices under /dev/input are open to members of the group input" if denied else ""
        what = f"{path} cannot be opened ({reason}){hint}"
        raise UserError(what, field="--hold", advice=_ADVICE) from error
    try:
        has_keys = _has_any(descriptor, _EVIOCGBIT_KEY)
    except OSError:
        has_keys = False
    if not has_keys:
        os.close(descriptor)
        raise UserError(f"{path} is not an input device with keys", field="--hold", advice=_ADVICE)
    return descriptor


def _has_any(descriptor: int, request: int) -> bool:
    """Whether a bit-field request sets any bit.

    Raises:
        OSError: It is no input device, or gone.
    """
    bits = bytearray(_KEY_BYTES)
    fcntl.ioctl(descriptor, request, bits)
    return any(bits)
