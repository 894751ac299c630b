"""Draws long runs in little memory: lines in pieces, shaded intervals with few corners."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from matplotlib.axes import Axes

Floats = NDArray[np.float64]

PIECE = 1000
"""Points of a line that are drawn at a time"""
MOST = 400
"""Largest number of separate intervals. More would be narrower than a pixel: the condition is then
sampled at twice as many moments."""


def line(ax: Axes, x: Floats, y: Floats, *, label: str | None = None, **style: Any) -> None:  # noqa: ANN401
    """Draw a solid line in pieces that share their ends; as one piece it would take over 100 MB.

    Matplotlib's own option (``agg.path.chunksize``) omits two segments between pieces.

    Args:
        ax: Where to.
        x: Shape (n,).
        y: Shape (n,); NaN is a gap.
        label: Label for the legend.
        style: As ``ax.plot`` takes it.
    """
    for start in range(0, max(x.size - 1, 1), PIECE):
        piece = slice(start, start + PIECE + 1)
        # No snapping: level pieces would be moved to whole pixels.
        ax.plot(x[piece], y[piece], label=None if start else label, snap=False, **style)


def outline(time: Floats, where: NDArray[np.bool_]) -> tuple[Floats, Floats]:
    """Return the corners of rectangles of height 1 over the intervals where a condition holds.

    Args:
        time: Increasing, shape (n,), n > 0.
        where: Whether it holds from each moment to the next, shape (n,).

    Returns:
        Times and heights for ``fill_between``; empty where it never holds.
    """
    edges = _edges(where)
    if edges.size > 2 * MOST:
        looked = np.searchsorted(time, np.linspace(time[0], time[-1], 2 * MOST), side="right") - 1
        time, where = time[looked], where[looked]
        edges = _edges(where)
    corners = time[np.minimum(edges, time.size - 1)]
    return np.repeat(corners, 2), np.tile([0.0, 1.0, 1.0, 0.0], edges.size // 2)


def _edges(where: NDArray[np.bool_]) -> NDArray[np.intp]:
    """Return the indices where intervals begin and end, alternating."""
    return np.flatnonzero(np.diff(np.concatenate([[False], where, [False]]).astype(np.int8)))
