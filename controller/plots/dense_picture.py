"""Pictures of long runs in little memory: lines drawn piece by piece, shade that stays simple."""

from __future__ import annotations

from contextlib import AbstractContextManager

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

PIECE = 1000
"""Points of a line that are drawn at a time"""
MOST = 400
"""More stretches than this are narrower than a picture shows; then it is looked in at so many
moments, twice over, where there is shade."""


def in_pieces() -> AbstractContextManager[None]:
    """While a picture is written: what a dense line covers is else held whole, 100 MB and more."""
    from matplotlib import rc_context

    return rc_context({"agg.path.chunksize": PIECE})


def outline(time: Floats, where: NDArray[np.bool_]) -> tuple[Floats, Floats]:
    """Corners of the stretches in which something holds, from 0 to 1 in height.

    Args:
        time: Increasing, shape (n,), n > 0.
        where: Whether it holds from each moment to the next, shape (n,).

    Returns:
        Times and heights for ``fill_between``; of no length where it never holds.
    """
    edges = _edges(where)
    if edges.size > 2 * MOST:
        looked = np.searchsorted(time, np.linspace(time[0], time[-1], 2 * MOST), side="right") - 1
        time, where = time[looked], where[looked]
        edges = _edges(where)
    corners = time[np.minimum(edges, time.size - 1)]
    return np.repeat(corners, 2), np.tile([0.0, 1.0, 1.0, 0.0], edges.size // 2)


def _edges(where: NDArray[np.bool_]) -> NDArray[np.intp]:
    """Where stretches begin and end, in turn."""
    return np.flatnonzero(np.diff(np.concatenate([[False], where, [False]]).astype(np.int8)))
