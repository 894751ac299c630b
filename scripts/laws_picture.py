"""Draws docs/pictures/laws.png: the elastic torque over position of each law that has one.

scripts/study laws_picture [FILE]
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np

from haptic_wall.controller.laws.friction import Friction
from haptic_wall.controller.laws.shape import Grid
from haptic_wall.controller.laws.table import EXAMPLES, shape_of
from haptic_wall.controller.report.style import BLUE, GREEN, INK, PAGE, grid, picture
from haptic_wall.controller.settings.model import Wall

PICTURE = Path(__file__).resolve().parent.parent / "docs" / "pictures" / "laws.png"
REACH = 0.8
"""Positions shown to either side [rad]"""
STIFFNESS = 8.0
"""K [N·m/rad]"""


def drawn(path: Path) -> None:
    """Draw the picture."""
    way = np.linspace(-REACH, REACH, 1601)
    examples = {law: numbers for law, numbers in EXAMPLES.items() if law != "damper"}
    rows = -(-len(examples) // 2)
    with picture(path, PAGE, 1.44 * rows) as figure:
        axes = figure.subplots(rows, 2, sharex=True).ravel()
        for ax in axes[len(examples) :]:
            ax.set_axis_off()
        for ax, (law, numbers) in zip(axes, examples.items(), strict=False):
            shape = shape_of(Wall.model_validate({"law": law, **numbers}), Grid(1e-3, 0.0))
            stiffness = getattr(shape, "stiffness", STIFFNESS)
            shape.settle(way[0])
            moved = np.concatenate([way, way[::-1]]) if isinstance(shape, Friction) else way
            torque = [-stiffness * shape.elongation(x, 0.0, stiffness) for x in moved.tolist()]
            ax.axhline(0.0, color=INK, linewidth=0.5)
            ax.plot(moved, torque, color=GREEN if shape.lowest_slope < 0.0 else BLUE, linewidth=1.2)
            said = ", ".join(f"{k} {v:g}" for k, v in numbers.items() if isinstance(v, float | int))
            ax.set_title(f"{law}: {said}" if said else law, fontsize=8.5, loc="left")
            grid(ax)
        for ax in axes[len(examples) - 2 : len(examples)]:
            ax.set_xlabel("position [rad]")
            ax.tick_params(labelbottom=True)
        for ax in axes[::2]:
            ax.set_ylabel("torque [N·m]")


def main() -> int:
    """Draw; return the exit status."""
    given = argparse.ArgumentParser(description=__doc__)
    given.add_argument("file", nargs="?", type=Path, default=PICTURE, metavar="FILE")
    drawn(given.parse_args().file)
    return 0
