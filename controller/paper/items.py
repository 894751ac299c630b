"""Lists the paper's results by name: captions, and the functions that make the files."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from haptic_wall.controller.paper import boundaries, linear_error, lwr3, table2
from haptic_wall.controller.paper.curves import FigureData, write_csv
from haptic_wall.controller.paper.numbers import Numbers, of_points, of_table2
from haptic_wall.controller.system.files import whole


@dataclass(frozen=True, slots=True)
class Item:
    """One result of the paper."""

    name: str
    """As on the command line; also the name of its files"""
    title: str
    shows: str
    """The caption: content and settings"""
    remark: str
    """Comparison with the printed result, and assumptions"""
    alternative: str
    """A description of the picture for readers who cannot see it"""
    wide: bool = False
    """Drawn over both columns of a journal's page"""


@dataclass(frozen=True, slots=True)
class Made:
    """An item's files, and their numbers."""

    item: Item
    csv: Path
    png: Path
    numbers: Numbers | None
    table: table2.Table2 | None
    """Of Table II only"""


_TABLE2 = Item(
    "table2",
    "Table II: critical stiffness by theory and by simulation",
    "All 36 cells for m = 1 kg, b = 0.1 N·s/m, T = 1 ms: the stiffness at which the loop starts "
    "to oscillate, by the exact boundary and by simulating the loop, beside the printed values. "
    "Picture: deviation of both from print; grey is half of the last printed digit (for B = 0.1, "
    "where it weighs most).",
    "Theory and simulation are independent of each other: theory solves the characteristic "
    "equation on the unit circle, the simulation moves the device and tests whether its "
    "oscillation grows. They agree within 0.001 %, far better than either with print, so the "
    "remaining deviation comes from the method behind the printed values.",
    "Dots: deviation of the 36 cells from print in percent over the delay. Theory and simulation "
    "lie on one another, most of them within 0.01 %; without delay the deviation is largest.",
)
_FIGURES: tuple[tuple[Item, Callable[[], FigureData], Callable[[FigureData, Path], None]], ...] = (
    (
        Item(
            "fig3",
            "Fig. 3: exact boundaries without delay and with one sample of it",
            "The stable region in the plane of virtual damping and stiffness for d = 0 and d = 1, "
            "with the greatest stable stiffness of each; δ = 0.0001. Hollow marks: the closed "
            "forms (1) and (13).",
            "The paper states the peaks as .686 and .144. Its plots are for δ < 0.001, where the "
            "curves no longer depend on it.",
            "Two arches from the origin. Without delay the peak is 0.6864 at β = 0.828, and the "
            "arch ends at β = 2; with one sample 0.1445 at 0.425, ending at 0.828.",
        ),
        boundaries.figure_3,
        boundaries.draw_figure_3,
    ),
    (
        Item(
            "fig4",
            "Fig. 4: the same at the origin",
            "Within a few δ of the origin, axes in multiples of δ; dashed: the linear condition "
            "(16), which for d = 0 and d = 1 is (4) and (5).",
            "The boundary starts at β = -δ: virtual damping may be negative down to the device's "
            "own. At this scale curve and line cannot be told apart.",
            "Two straight-looking boundaries that start together at β = -δ; slope 2 without delay "
            "and 2/3 with one sample, each covered by its dashed line.",
        ),
        boundaries.figure_4,
        boundaries.draw_figure_4,
    ),
    (
        Item(
            "fig5",
            "Fig. 5: exact boundaries for eight delays",
            "Delays of 0 to 3 samples, fractions too; dots mark the peaks; δ = 0.0001.",
            "Computed in closed form for every delay; the numbers of the peaks are ours.",
            "Eight arches from the origin, one within the other; the longer the delay, the lower "
            "the peak (0.686 to 0.035) and the earlier the end (β = 2 to 0.4).",
        ),
        boundaries.figure_5,
        boundaries.draw_figure_5,
    ),
    (
        Item(
            "fig6",
            "Fig. 6: the same near the origin, with the straight lines",
            "Solid: exact; dashed: the linear condition (16); inset: within a few δ.",
            "The range is chosen so that the exact boundary can be seen to fall below its line.",
            "A fan of eight curves, each with its dashed tangent at the origin; at β = 0.1 the "
            "curves are 10 % (d = 0) to 18 % (d = 3) below.",
        ),
        boundaries.figure_6,
        boundaries.draw_figure_6,
    ),
    (
        Item(
            "fig8",
            "Fig. 8: robot axis with short delays",
            "Axis 3 of the DLR Light-Weight Robot III, two-sided wall, no user, T = 1 ms; overall "
            "delays of 5 ms (the system's own), 6 and 10 ms: the lines K = (b + B) / (T/2 + t_d).",
            "Only the lines can be given: the measured points are not printed as numbers, nor is "
            "the axis' damping b. Drawn with b = 0.1 N·m·s/rad, an assumption: another b shifts "
            "all lines to the left by the difference, and leaves their slopes. The range of B is "
            "ours.",
            "Three straight lines from the origin; at B = 20 N·m·s/rad they reach 3655, 3092 and "
            "1914 N·m/rad for 5, 6 and 10 ms.",
        ),
        lwr3.figure_8,
        lwr3.draw_figure_8,
    ),
    (
        Item(
            "fig9",
            "Fig. 9: robot axis with long delays",
            "The same axis at overall delays of 10 and 55 ms: the exact boundary for an inertia "
            "of 0.8 kg·m², its peak, and the straight line (dashed).",
            "The inertia is printed; b = 0.1 N·m·s/rad is assumed, which at this scale moves "
            "the curve by less than its width. The measured points are not printed as numbers.",
            "Two panels, each an arch under its tangent: the peak is 3649 N·m/rad at "
            "B = 67.2 N·m·s/rad for 10 ms, and 142 at 13.5 for 55 ms.",
        ),
        lwr3.figure_9,
        lwr3.draw_figure_9,
    ),
    (
        Item(
            "fig10",
            "Fig. 10: where the linear condition errs by 2 % and by 5 %",
            "Exact boundaries, and on each the points where the linear condition errs by 2 % and "
            "5 %; (a) δ = 0, (b) δ = 0.01; dashed: the lines. A positive error means that the "
            "exact boundary is above the line, a negative one that the line promises too much.",
            "For δ = 0.01 and d = 3 the error is above 2 % from the start and passes through zero "
            "to -2 %, so there are two points of 2 %; the shorter delays drawn never reach +2 %.",
            "Two panels of eight curves near the origin with marks; the points of equal error "
            "move towards the origin with the delay.",
            wide=True,
        ),
        linear_error.figure_10,
        linear_error.draw_figure_10,
    ),
)
ITEMS = (_TABLE2, *(item for item, _, _ in _FIGURES))
"""In the paper's order"""


def make(name: str, folder: Path, simulate: table2.Simulate | None = None) -> Made:
    """Compute an item and write its CSV and PNG.

    Args:
        name: Name of an item.
        folder: Existing folder for the files.
        simulate: For Table II; None: the experiment of this program.

    Raises:
        KeyError: There is no such item.
        OSError: A file cannot be written.
    """
    csv, png = folder / f"{name}.csv", folder / f"{name}.png"
    into_table, into_png = whole(csv), whole(png)
    if name == _TABLE2.name:
        table = table2.compare(simulate)
        with into_table as csv_part, into_png as png_part:
            table2.write_csv(table, csv_part)
            table2.draw(table, png_part)
        return Made(_TABLE2, csv, png, of_table2(table), table)
    item, compute, draw = {item.name: (item, c, d) for item, c, d in _FIGURES}[name]
    data = compute()
    with into_table as csv_part, into_png as png_part:
        write_csv(data, csv_part)
        draw(data, png_part)
    return Made(item, csv, png, of_points(data), None)
