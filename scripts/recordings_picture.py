"""Draws docs/pictures/recordings.png: two free swings of a real servo, fitted and predicted.

scripts/study recordings_picture [FILE]
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np

from haptic_wall.controller.experiments.recorded.record import pieces_of
from haptic_wall.controller.report import style
from scripts.recorded_motions import DROPS, drop, predicted
from scripts.studies.recordings import swings

PICTURE = Path(__file__).resolve().parent.parent / "docs" / "pictures" / "recordings.png"


def drawn(path: Path) -> None:
    """Draw the picture."""
    alone = {name: swings((name,), "M1") for name in DROPS}
    both = swings(DROPS, "M2")
    with style.picture(path, style.PAGE, 4.2) as figure:
        axes = figure.subplots(2, 2, sharex="col", height_ratios=[1.6, 1.0])
        for column, (name, other) in enumerate(zip(DROPS, reversed(DROPS), strict=True)):
            above, below = axes[:, column]
            pieces, _ = pieces_of(drop(name))
            time, held = pieces.sampled[0], pieces.held[0]
            measured = pieces.position[0]
            above.plot(time, measured, color=style.INK, linewidth=0.9, label="measured")
            ahead = alone[other]
            for label, found, colour in (
                ("M1, fitted to it", alone[name].fitted[0], style.BLUE),
                (
                    "M1, predicted by the other",
                    predicted(pieces, ahead.terms)[0],
                    style.ORANGE,
                ),
                (
                    "M2 of both, from 0.2 s",
                    predicted(pieces, both.terms)[0],
                    style.GREEN,
                ),
            ):
                above.plot(time[held], found[held], color=colour, linewidth=0.8, linestyle="--",
                           label=label)  # fmt: skip
                left = 1e3 * (measured - found)
                rms = float(np.sqrt(np.mean(left[held] ** 2)))
                below.plot(time[held], left[held], color=colour, linewidth=0.7,
                           label=f"{rms:.1f} mrad rms")  # fmt: skip
            above.set_title(name.replace("_", " "), fontsize=8.5, loc="right", y=1.16)
            style.legend_above(below, columns=3)
            below.set_xlabel("time [s]")
            style.legend_above(above, columns=2)
            for ax in (above, below):
                style.grid(ax)
        axes[0, 0].set_ylabel("position [rad]")
        axes[1, 0].set_ylabel("residual [mrad]")


def main() -> int:
    """Draw; return the exit status."""
    given = argparse.ArgumentParser(description=__doc__)
    given.add_argument("file", nargs="?", type=Path, default=PICTURE, metavar="FILE")
    drawn(given.parse_args().file)
    return 0
