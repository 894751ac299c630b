"""Counts the samples of a histogram in bins: enough to draw, and small enough to keep."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from haptic_wall.controller.bench.rows import Histogram
from haptic_wall.controller.theory.checks import FloatArray

_BINS = 120
_LEAST = 1e-6
"""Fraction of the largest sample; smaller samples are counted with those of this size"""
_ROUNDING = 1e-6
"""Tolerance for products: 99.9 % of 1000 are 999 samples, whatever the rounding"""
_PERCENTILES = {"p50": 50.0, "p99": 99.0, "p99_9": 99.9}


def percentile(values: NDArray[Any], q: float) -> float:
    """Return the least value that q % of the values do not exceed.

    Args:
        values: At least one.
        q: In percent, > 0.
    """
    place = math.ceil(q / 100.0 * values.size - _ROUNDING) - 1
    return float(np.partition(values, place)[place])


def binned(histogram: Histogram) -> dict[str, Any]:
    """Count every series in the same bins; add the percentiles of the samples themselves.

    Bins have equal ratios where no sample is below zero, equal widths otherwise. Series without
    samples are left out.

    Returns:
        ``name``, ``unit``, ``scale`` (``log`` or ``linear``), ``edges`` of the bins, and ``series``
        with ``counts``, ``p50``, ``p99``, ``p99_9``, ``max`` and ``samples`` by name.
    """
    series = {
        name: np.asarray(samples, dtype=np.float64)
        for name, samples in histogram.series.items()
        if len(samples)
    }
    every = np.concatenate([*series.values(), []])
    scale = "log" if every.size and every.min() >= 0.0 < every.max() else "linear"
    edges = _edges(every, scale) if every.size else np.empty(0)
    return {
        "name": histogram.name,
        "unit": histogram.unit,
        "scale": scale,
        "edges": edges.tolist(),
        "series": {
            name: {
                "counts": _counts(samples, edges),
                **{key: percentile(samples, q) for key, q in _PERCENTILES.items()},
                "max": float(samples.max()),
                "samples": int(samples.size),
            }
            for name, samples in series.items()
        },
    }


def _edges(every: FloatArray, scale: str) -> FloatArray:
    if scale == "log":
        high = float(every.max())
        low = max(float(every[every > 0.0].min()), _LEAST * high)
        # Slightly beyond both ends, so that no sample is outside after rounding.
        return np.geomspace(0.8 * low, 1.25 * high, _BINS + 1)
    low, high = float(every.min()), float(every.max())
    margin = 0.01 * (high - low) or 1.0
    return np.linspace(low - margin, high + margin, _BINS + 1)


def _counts(samples: FloatArray, edges: FloatArray) -> list[int]:
    """Return the number of samples in each bin; lower samples count in the lowest."""
    counts, _ = np.histogram(np.clip(samples, edges[0], edges[-1]), edges)
    counted: list[int] = counts.tolist()
    return counted
