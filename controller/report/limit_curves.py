"""Draws the guard's limits over the virtual damping, one look for each limit."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np

from haptic_wall.controller.guard.limits import BY_NAME
from haptic_wall.controller.report import style
from haptic_wall.controller.theory.checks import FloatArray

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_LOOKS = {
    "linear": (style.GREY, "--"),
    "exact": (style.BLUE, "-"),
    "one_sided": (style.GREEN, "-"),
    "quantisation": ("#a5004f", ":"),
    "passive": (style.ORANGE, "-"),
    "backlash": ("#7a4b00", "-."),
    "flexible": ("#5a3fa0", "--"),
}


def draw_limits(
    ax: Axes, damping: FloatArray, limits: Mapping[str, FloatArray], most: float
) -> None:
    """Draw each limit where it is above zero and not above ``most`` [N·m/rad].

    Args:
        ax: Axes to draw on.
        damping: [N·m·s/rad]
        limits: By name, arrays of that length [N·m/rad].
        most: Limits above are not drawn.
    """
    for name, values in limits.items():
        color, line = _LOOKS.get(name, (style.INK, ":"))
        where = np.flatnonzero(values > 0)
        if where.size:
            shown = slice(max(where[0] - 1, 0), where[-1] + 2)
            within = np.where(values <= most, values, np.nan)[shown]
            ax.plot(damping[shown], within, line, color=color, label=BY_NAME[name].label)
