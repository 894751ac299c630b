"""The style of the figures: one journal column wide, serif, colours for the colour-blind."""

from __future__ import annotations

import os
import warnings
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import IO, TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from haptic_wall.controller.system.printable import in_line

if TYPE_CHECKING:
    from matplotlib.artist import Artist
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

DOTTED, DASHED = (0, (1, 2)), (0, (3, 1.5))
"""Line styles"""
COLUMN = 3.5
"""Width of a journal's column [inch]"""
PAGE = 7.16
"""Width of both columns [inch]"""
INK, BLUE, ORANGE, GREEN = "#222222", "#0072b2", "#d55e00", "#009e73"
GREY, FAINT = "#6b6b6b", "#dfe9f2"
BETA = r"dimensionless virtual damping  $\beta = BT/m$"
ALPHA = r"dimensionless stiffness  $\alpha = KT^2/m$"
STIFFNESS = r"stiffness  $K$  [N$\cdot$m/rad]"
VIRTUAL_DAMPING = r"virtual damping  $B$  [N$\cdot$m$\cdot$s/rad]"


def _root(value: NDArray[np.float64]) -> NDArray[np.float64]:
    root: NDArray[np.float64] = np.sign(value) * np.sqrt(np.abs(value))
    return root


def _square(value: NDArray[np.float64]) -> NDArray[np.float64]:
    square: NDArray[np.float64] = np.sign(value) * np.square(value)
    return square


ROOTS = _root, _square
"""Of an axis with more room near zero, where walls are used and limits rise steeply: the scale, and
its inverse"""

_FONT: dict[Any, Any] = {"font.family": "STIXGeneral", "mathtext.fontset": "stix"}
RUN_STYLE = {**_FONT, "font.size": 11, "figure.dpi": 120}
"""Of a run: for a screen"""
_STYLE: dict[Any, Any] = {
    **_FONT,
    "font.size": 8.5,
    "axes.labelsize": 9,
    "xtick.labelsize": 8,
    "ytick.labelsize": 8,
    "legend.fontsize": 8,
    "legend.frameon": False,
    "axes.linewidth": 0.6,
    "axes.axisbelow": True,
    "lines.linewidth": 1.2,
    "xtick.direction": "in",
    "ytick.direction": "in",
    "xtick.major.width": 0.6,
    "ytick.major.width": 0.6,
    "xtick.top": True,
    "ytick.right": True,
    "savefig.dpi": 300,
}


@contextmanager
def drawing(style: dict[Any, Any]) -> Iterator[None]:
    """Draw with Matplotlib's own settings and a style, whatever the user's settings are.

    Args:
        style: Settings that differ from Matplotlib's own.
    """
    # The backend of a notebook or of another program may not exist here; it is read on import only.
    backend = os.environ.pop("MPLBACKEND", None)
    try:
        import matplotlib
    finally:
        if backend is not None:
            os.environ["MPLBACKEND"] = backend
    # Letters that the font lacks become boxes.
    with warnings.catch_warnings(), matplotlib.rc_context():
        warnings.filterwarnings("ignore", message="Glyph")
        matplotlib.rcdefaults()
        matplotlib.rcParams["agg.path.chunksize"] = 5000  # a long line as one takes 100 MB
        matplotlib.rcParams.update(style)
        yield


@contextmanager
def picture(
    path: Path | IO[bytes], width: float, height: float, style: dict[Any, Any] | None = None
) -> Iterator[Figure]:
    """Yield a figure, written as PNG at the end; equal data give an equal file.

    Args:
        path: A file's path, or a stream open for writing.
        width: [inch].
        height: [inch].
        style: Settings of Matplotlib; None: those of a journal.

    Raises:
        OSError: The file cannot be written.
    """
    with drawing(_STYLE if style is None else style):
        # Imported here because it takes a second, which only pictures should cost. Without pyplot
        # no figure survives the call.
        from matplotlib.backends.backend_agg import FigureCanvasAgg
        from matplotlib.figure import Figure

        figure = Figure(figsize=(width, height), layout="constrained")
        FigureCanvasAgg(figure)
        yield figure
        figure.savefig(path, format="png", metadata={"Software": "haptic-wall"})


def titled(name: str) -> str:
    """Return any name as one line for a title, without formulas."""
    return in_line(name).replace("$", r"\$")


def grid(ax: Axes) -> None:
    """Draw faint lines behind the curves."""
    ax.grid(True, color="#e9e9e9", linewidth=0.5)


def shade(ax: Axes, time: NDArray[np.float64], where: NDArray[np.bool_], **style: Any) -> None:  # noqa: ANN401
    """Shade the times from each moment to the next at which a condition holds.

    Args:
        ax: Where to.
        time: Increasing, shape (n,).
        where: Whether it holds from each moment on, shape (n,).
        style: As ``ax.fill_between`` takes it.
    """
    until = where.copy()
    until[1:] |= where[:-1]
    across = ax.get_xaxis_transform()
    ax.fill_between(time, 0.0, 1.0, where=until, transform=across, linewidth=0.0, **style)


def legend_above(ax: Axes, columns: int = 1) -> None:
    """Draw the legend above the axes, where it covers no curve."""
    ax.legend(
        loc="lower left",
        bbox_to_anchor=(0.0, 1.0),
        borderaxespad=0.2,
        ncols=columns,
        handlelength=1.4,
        columnspacing=1.2,
    )


def key(label: str, **look: Any) -> Artist:  # noqa: ANN401
    """Return an entry of a legend for something that is drawn several times.

    Args:
        label: Its text.
        look: As ``ax.plot`` takes it; a line in ink unless it says otherwise.
    """
    from matplotlib.lines import Line2D

    return Line2D([], [], label=label, **{"color": INK, **look})


def shades(count: int) -> Sequence[str]:
    """Return ``count`` colours in order, dark to light, that also differ in lightness."""
    from matplotlib import colormaps
    from matplotlib.colors import to_hex

    last = max(count - 1, 1)
    return [to_hex(colormaps["viridis"](0.85 * i / last)) for i in range(count)]
