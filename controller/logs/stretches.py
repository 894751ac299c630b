"""Splits the times of samples into stretches without gaps, each with its own rate."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from haptic_wall.controller.logs.recording import GAP, LEAST, Floats

_DEEPEST = 4
"""Largest number of times that a stretch is split again at its own rate"""
_SPARSE = 2.0
"""Largest number of grid points per sample; more would mostly be invented."""


@dataclass(frozen=True, slots=True)
class Stretch:
    """Samples from ``start`` up to, but without, ``end``."""

    start: int
    end: int
    period: float
    """Usual time between samples [s]; NaN: there is one sample"""

    @property
    def size(self) -> int:
        """Return the number of samples."""
        return self.end - self.start


def stretches(times: Floats) -> list[Stretch]:
    """Split samples at long gaps, measured by the rate before and after.

    Two recordings a day apart, or of different rates, are two stretches.

    Args:
        times: Increasing, shape (n,), n > 0 [s].
    """
    return [
        Stretch(start, end, _period(times[start:end]))
        for start, end in _parted(times, 0, times.size, _DEEPEST)
    ]


def _parted(times: Floats, start: int, end: int, deeper: int) -> list[tuple[int, int]]:
    steps = np.diff(times[start:end])
    breaks = np.flatnonzero(steps > GAP * np.median(steps)) if steps.size else steps
    if breaks.size == 0 or deeper == 0:
        return [(start, end)]
    edges = start + np.concatenate([[0], breaks + 1, [end - start]])
    # Samples that are isolated at this rate may belong to a slower recording.
    short = np.diff(edges) < LEAST
    edges = np.concatenate([edges[:1], edges[1:-1][~(short[:-1] & short[1:])], edges[-1:]])
    if edges.size == 2:
        return [(start, end)]
    found = []
    for first, last in zip(edges[:-1].tolist(), edges[1:].tolist(), strict=True):
        found += _parted(times, first, last, deeper - 1)
    return found


def _period(times: Floats) -> float:
    """Return the usual time between samples [s]."""
    if times.size < 2:
        return np.nan
    steps = np.diff(times)
    median = np.median(steps)
    usual = steps[np.abs(steps - median) <= 0.5 * median]
    mean = float(np.mean(steps))
    # Samples in bursts may have no usual step.
    period = float(np.mean(usual)) if usual.size else mean
    return period if mean <= _SPARSE * period else mean
