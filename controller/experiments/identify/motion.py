"""Holds a recorded motion, and its division into pieces."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from haptic_wall.controller.theory.checks import FloatArray, IntArray
from haptic_wall.hw.servo import Outcome


@dataclass(frozen=True, slots=True)
class Motion:
    """Recorded positions at their sampling instants, and torques at their sending instants."""

    sampled: FloatArray
    """Instants of the samples [s], rising, shape (n,)"""
    position: FloatArray
    """[rad], shape (n,)"""
    sent: FloatArray
    """Instants of the torques [s], rising, shape (k,)"""
    torque: FloatArray
    """Held from its instant to the next [N·m], shape (k,)"""

    @property
    def driven(self) -> bool:
        """Return whether any torque was sent."""
        return bool(np.any(self.torque != 0.0))


def motion_of(rows: NDArray[np.void]) -> Motion:
    """Return the motion that the rows of a log record.

    Failed readings have no sample; the torques of their rows were still sent.

    Args:
        rows: Shape (n,), dtype ``telemetry.ROW``, of one run without gaps.
    """
    known = rows[rows["sampled_ns"] > 0]
    begun = int(known["sampled_ns"][0]) if known.size else 0
    good = known[known["outcome"] == Outcome.OK]
    sampled: FloatArray = (good["sampled_ns"] - begun) * 1e-9
    since: IntArray = known["sampled_ns"] - begun
    age: IntArray = known["age_ns"]
    return Motion(
        sampled=sampled,
        position=good["position"].copy(),
        sent=(since + age).astype(np.float64) * 1e-9,
        torque=known["torque"].copy(),
    )


@dataclass(frozen=True, slots=True)
class Pieces:
    """A motion in s pieces: arrays of shape (s, n), short pieces padded to the longest."""

    motion: Motion
    sampled: FloatArray
    """[s]; padding repeats a piece's last instant"""
    position: FloatArray
    """[rad]"""
    held: NDArray[np.bool_]
    """True: a sample; False: padding"""


def pieces_of(motion: Motion, cuts: Sequence[tuple[int, int]]) -> Pieces:
    """Divide a motion into pieces.

    Args:
        motion: The recorded motion.
        cuts: First sample of each piece and the one after its last.
    """
    longest = max(end - begin for begin, end in cuts)
    index = np.array([begin + np.arange(longest) for begin, _ in cuts])
    ends = np.array([end for _, end in cuts])[:, None]
    held = index < ends
    index = np.minimum(index, ends - 1)
    return Pieces(motion, motion.sampled[index], motion.position[index], held)


def taken(pieces: Pieces, kept: NDArray[np.bool_]) -> Pieces:
    """Return the pieces for which ``kept``, shape (s,), is true."""
    return Pieces(pieces.motion, pieces.sampled[kept], pieces.position[kept], pieces.held[kept])
