"""Passes a person's hand position to a simulated servo by shared memory, 30 times a second.

The spring between the hand and the shaft is part of the simulated motion, and only the hand's
position comes from outside: a spring closed over that connection would be unstable. Between two
positions the hand moves evenly. It lets go by itself when no position comes.
"""

from __future__ import annotations

import mmap
import os
import struct
from collections.abc import Sequence
from typing import Final, NamedTuple, Self

SILENCE_NS: Final = 150_000_000
"""Longest time between two positions of a hand that holds on [ns]"""
EVERY_NS: Final = 50_000_000
"""Time in which the hand moves to a new position [ns]"""
FASTEST: Final = 20.0
"""Highest speed of the hand [rad/s]"""
MOST_STIFFNESS: Final = 50.0
"""[N·m/rad]"""
DAMPING: Final = 0.1
"""Of its damper, over the square root of its stiffness [sqrt(N·m/rad)·s]: that of the scripted
operator"""
_FIELDS: Final = struct.Struct("<qqqddd")
_NUMBER: Final = struct.Struct("<q")
_MOUNT: Final = struct.Struct("<dd")
"""Sign and offset of the servo"""
_MOUNT_AT: Final = 64
_EACH: Final = 128
"""Bytes of an axis"""
_SIZE: Final = 4096
_TRIES: Final = 3


class Grasp(NamedTuple):
    """The hand as it holds the shaft."""

    begin_ns: int
    """When it was at ``origin`` [ns]"""
    until_ns: int
    """When it lets go, unless it is heard of before [ns]"""
    origin: float
    """[rad]"""
    target: float
    """Where it is ``EVERY_NS`` later, and stays [rad]"""
    stiffness: float
    """Of the spring between hand and shaft [N·m/rad]"""

    @property
    def slope(self) -> float:
        """Return its speed on the way [rad/s]."""
        return (self.target - self.origin) / (EVERY_NS * 1e-9)

    @property
    def damping(self) -> float:
        """Return that of the damper between hand and shaft [N·m·s/rad]."""
        return DAMPING * float(self.stiffness**0.5)

    def position(self, now_ns: int) -> float:
        """Return where it is [rad]."""
        since_s = min(max(now_ns - self.begin_ns, 0), EVERY_NS) * 1e-9
        return self.origin + self.slope * since_s


class SharedHand:
    """The memory, from the side of one process: the hand on the shaft of an axis.

    Args:
        descriptor: Of a memory made by ``create``, possibly inherited.
        axis: Index of the axis.
    """

    def __init__(self, descriptor: int, axis: int = 0) -> None:
        self.descriptor = descriptor
        whole = memoryview(mmap.mmap(descriptor, _SIZE))
        self._map = whole[_EACH * axis : _EACH * (axis + 1)]
        self._sign, self._offset = _MOUNT.unpack_from(self._map, _MOUNT_AT)
        self._last: Grasp | None = None

    @classmethod
    def create(cls, mounts: Sequence[tuple[int, float]] = ((1, 0.0),)) -> Self:
        """Return the hand on the first shaft, which holds nothing; the caller closes it.

        Args:
            mounts: Sign and offset [rad] of each servo, see ``DriverSettings``: the hand is told
                positions of the joint.
        """
        descriptor = os.memfd_create("haptic-wall-hand")
        os.ftruncate(descriptor, _SIZE)
        for axis, mount in enumerate(mounts):
            os.pwrite(descriptor, _MOUNT.pack(*mount), _EACH * axis + _MOUNT_AT)
        return cls(descriptor)

    def of(self, axis: int) -> SharedHand:
        """Return the hand on the shaft of an axis, by its index."""
        return SharedHand(self.descriptor, axis)

    def close(self) -> None:
        """Close the descriptor."""
        os.close(self.descriptor)

    def hold(self, target: float, stiffness: float, shaft: float, now_ns: int) -> None:
        """Hold on, and move to a position; the only writer calls it.

        Args:
            target: Of the hand [rad].
            stiffness: Of the spring between hand and shaft [N·m/rad].
            shaft: Position of the shaft, where the hand takes it [rad].
            now_ns: The present time on the servo's clock [ns].
        """
        target, shaft = (self._sign * (each - self._offset) for each in (target, shaft))
        last = self._last
        held = last is not None and now_ns < last.until_ns
        origin = last.position(now_ns) if held and last is not None else shaft
        most = FASTEST * EVERY_NS * 1e-9
        target = min(max(target, origin - most), origin + most)
        stiffness = min(max(stiffness, 0.0), MOST_STIFFNESS)
        self._write(Grasp(now_ns, now_ns + SILENCE_NS, origin, target, stiffness))

    def release(self) -> None:
        """Let go; the only writer calls it."""
        self._write(Grasp(0, 0, 0.0, 0.0, 0.0))

    def look(self, now_ns: int) -> Grasp | None:
        """Return how the hand holds the shaft; None: it does not."""
        for _ in range(_TRIES):
            number, *grasp = _FIELDS.unpack_from(self._map)
            if number % 2 == 0 and _NUMBER.unpack_from(self._map)[0] == number:
                self._last = Grasp(*grasp)
                break
        last = self._last
        return last if last is not None and now_ns < last.until_ns and last.stiffness > 0 else None

    def _write(self, grasp: Grasp) -> None:
        """Write a grasp; its number is odd meanwhile."""
        self._last = grasp
        number = _NUMBER.unpack_from(self._map)[0] | 1
        _NUMBER.pack_into(self._map, 0, number)
        _FIELDS.pack_into(self._map, 0, number, *grasp)
        _NUMBER.pack_into(self._map, 0, number + 1)
