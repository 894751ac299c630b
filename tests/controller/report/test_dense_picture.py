"""Lines drawn in pieces look like lines drawn whole."""

import io
from collections.abc import Callable

import numpy as np
import pytest
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from haptic_wall.controller.report.dense_picture import PIECE, line


def pixels(draw: Callable[[Axes], object]) -> NDArray[np.uint8]:
    """What is drawn on an empty square, as grey levels."""
    figure = Figure(figsize=(4, 4), dpi=100)
    ax = figure.add_axes((0, 0, 1, 1))
    ax.axis("off")
    draw(ax)
    ax.set(xlim=(-100, 3 * PIECE), ylim=(-0.1, 1.1))
    image = io.BytesIO()
    figure.savefig(image, format="rgba")
    return np.frombuffer(image.getvalue(), np.uint8).reshape(400, 400, 4)[:, :, 0]


@pytest.mark.parametrize("at", [*range(PIECE - 3, PIECE + 3), 2 * PIECE])
@pytest.mark.parametrize("drawstyle", ["default", "steps-post"])
def test_a_steep_line_is_whole_at_the_joints(at: int, drawstyle: str) -> None:
    x = np.arange(2.5 * PIECE)
    y = (x >= at).astype(float)
    drawn = pixels(lambda ax: line(ax, x, y, color="k", linewidth=2, drawstyle=drawstyle))
    assert np.all(drawn.min(axis=1)[40:360] < 200)  # something in every row
    whole = pixels(lambda ax: ax.plot(x, y, color="k", linewidth=2, drawstyle=drawstyle))
    assert np.count_nonzero((whole < 100) & (drawn > 200)) == 0
