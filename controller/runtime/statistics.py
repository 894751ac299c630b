"""Computes statistics of a run from its rows: percentiles of times, extremes of torque.

It runs outside the loop's process, on batches of rows, in bounded memory: times are counted in bins
1.6 % wide; the maximum is exact.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from haptic_wall.controller.runtime.telemetry import FLAG_OFF, FLAG_SATURATED, FLAG_WARM_UP
from haptic_wall.hw.servo import Outcome

_PER_OCTAVE = 64
_BINS = _PER_OCTAVE * 48
_NO_STIFFNESS = 1e-6
"""Below this, a commanded stiffness [N·m/rad] is none: a turn of the shaft gives no torque"""
_LEAST_NS = 16.0
"""Times below this [ns] share one bin: no clock here resolves them."""


class TimeStatistics:
    """Percentiles of a time in nanoseconds, reported in microseconds."""

    def __init__(self) -> None:
        self._counts = np.zeros(_BINS, dtype=np.int64)
        self._max = -np.inf

    def add(self, times_ns: NDArray[np.int64]) -> None:
        """Count a batch of times [ns], shape (n,)."""
        if times_ns.size == 0:
            return
        octaves = np.log2(np.maximum(times_ns, _LEAST_NS) / _LEAST_NS)
        bins = np.minimum((octaves * _PER_OCTAVE).astype(np.int64), _BINS - 1)
        self._counts += np.bincount(bins, minlength=_BINS)
        self._max = max(self._max, float(times_ns.max()))

    def percentile_us(self, percentile: float) -> float | None:
        """Return a percentile [%] of the counted times [µs]; None if no time was counted."""
        total = int(self._counts.sum())
        if total == 0:
            return None
        place = int(np.searchsorted(np.cumsum(self._counts), percentile / 100.0 * total))
        if place == 0:
            return max(0.0, min(self._max, _LEAST_NS)) / 1000.0
        return float(min(_LEAST_NS * 2.0 ** ((place + 0.5) / _PER_OCTAVE), self._max)) / 1000.0

    def as_report(self, *percentiles: float) -> dict[str, float | None]:
        """Return ``{p50: .., p99: .., max: ..}`` [µs] for the given percentiles."""
        report = {f"p{p:g}".replace(".", "_"): self.percentile_us(p) for p in percentiles}
        report["max"] = self._max / 1000.0 if np.isfinite(self._max) else None
        return report


class RunStatistics:
    """The report's statistics of times and torques.

    Ticks of the warm-up are not counted. A row has the work and bus times of the tick before, so
    those of the first row are left out.

    Args:
        axes: Number of axes.

    Attributes:
        max_torque: Of each axis [N·m], shape (axes,).
        saturated: Ticks in which the torque of each axis was limited, shape (axes,).
        acted: Ticks in which the wall of each axis was on, shape (axes,).
        limp: Those of them in which it had no stiffness, shape (axes,).
        next_seq: Sequence number after the last row.
    """

    def __init__(self, axes: int = 1) -> None:
        self.lateness = TimeStatistics()
        self.work = TimeStatistics()
        self.bus = TimeStatistics()
        self.age = TimeStatistics()
        self.max_torque = np.zeros(axes)
        self.saturated, self.acted, self.limp = np.zeros((3, axes), np.int64)
        self.unread = 0
        """Rows that were overwritten before they were read."""
        self.next_seq = 0

    def add(self, rows: NDArray[np.void]) -> None:
        """Count a batch of rows, shape (ticks, axes), dtype ``telemetry.ROW``."""
        if rows.size == 0:
            return
        ticks = rows[:, 0]
        self.unread += int(ticks["seq"][-1]) + 1 - self.next_seq - ticks.size
        self.next_seq = int(ticks["seq"][-1]) + 1
        # Column by column: selecting whole rows would copy them field by field.
        on = (ticks["flags"] & FLAG_WARM_UP) == 0
        if not on.any():
            return
        self.lateness.add(ticks["lateness_ns"][on])
        after_first = on & (ticks["seq"] > 0)
        self.work.add(ticks["work_ns"][after_first])
        self.bus.add(ticks["bus_ns"][after_first])
        self.age.add(rows["age_ns"][on[:, None] & (rows["outcome"] == Outcome.OK)])
        self.max_torque = np.maximum(self.max_torque, np.abs(rows["torque"][on]).max(axis=0))
        flags = rows["flags"][on]
        acted = flags & FLAG_OFF == 0
        self.saturated += np.count_nonzero(flags & FLAG_SATURATED, axis=0)
        self.acted += np.count_nonzero(acted, axis=0)
        self.limp += np.count_nonzero(acted & (rows["stiffness"][on] < _NO_STIFFNESS), axis=0)

    def torque(self, axis: int | None = None) -> dict[str, Any]:
        """Return the report's part on the torque of an axis; None: the largest of all."""
        some = slice(None) if axis is None else axis
        return {
            "max": float(self.max_torque[some].max()),
            "saturated_ticks": int(self.saturated[some].max()),
        }
