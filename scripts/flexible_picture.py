"""Draws docs/pictures/flexible.png: exact critical stiffness of a servo with a link over damping.

scripts/study flexible_picture [FILE]
"""

from __future__ import annotations

import argparse
import math
from pathlib import Path
from typing import NamedTuple

import numpy as np

from haptic_wall.controller.report import style
from haptic_wall.controller.theory.boundary import chain_boundary
from haptic_wall.controller.theory.chain import two_masses
from haptic_wall.controller.theory.velocity_filter import VelocityFilter

PICTURE = Path(__file__).resolve().parent.parent / "docs" / "pictures" / "flexible.png"
PERIOD, DELAY = 1e-3, 1e-3
MOTOR, FRICTION = 0.011951, 0.011692
"""Of an MX-64 [kg·m², N·m·s/rad]"""
STIFFNESS, RATIO = 200.0, 0.02
"""Of the transmission [N·m/rad], and its damping ratio"""
LAST = 0.55
"""Last virtual damping of the picture [N·m·s/rad]"""


class Load(NamedTuple):
    """A load behind the transmission."""

    name: str
    inertia: float
    colour: str
    notch_q: float = 0.0
    """Quality of a notch of the velocity at the vibration; 0: none"""

    @property
    def hertz(self) -> float:
        """Return the frequency of the vibration, both ends free [Hz]."""
        return math.sqrt(STIFFNESS * (1.0 / MOTOR + 1.0 / self.inertia)) / math.tau

    @property
    def servo(self) -> tuple[float, float, float, float, float]:
        """Return the first arguments of the theory's functions of two masses."""
        moving = MOTOR * self.inertia / (MOTOR + self.inertia)
        return (
            MOTOR,
            FRICTION,
            self.inertia,
            STIFFNESS,
            2.0 * RATIO * math.sqrt(STIFFNESS * moving),
        )

    @property
    def velocity_filter(self) -> VelocityFilter | None:
        """Return the filter of the velocity."""
        if self.notch_q == 0.0:
            return None
        return VelocityFilter("notch", math.tau * self.hertz * PERIOD, self.notch_q)


HORN = Load("a bare horn", 1e-4, style.BLUE)
LINK = Load("a horn with a link", 0.003, style.ORANGE)
LOADS = (HORN, LINK, LINK._replace(name="a link and a notch", colour=style.GREEN, notch_q=0.7))


def drawn(path: Path) -> None:
    """Draw the picture."""
    damping = np.linspace(0.0, LAST, 400)
    with style.picture(path, style.PAGE, 4.0) as figure:
        ax = figure.subplots()
        for load in LOADS:
            exact = chain_boundary(
                *two_masses(*load.servo),
                damping,
                PERIOD,
                DELAY,
                velocity_filter=load.velocity_filter,
            ).stiffness
            ax.plot(damping, exact, color=load.colour, label=load.name)
        ax.set_xlim(0.0, LAST)
        ax.set_ylim(bottom=0.0)
        ax.set_xlabel(style.VIRTUAL_DAMPING)
        ax.set_ylabel(style.STIFFNESS)
        ax.legend(loc="upper left")
        style.grid(ax)


def main() -> int:
    """Draw; return the exit status."""
    given = argparse.ArgumentParser(description=__doc__)
    given.add_argument("file", nargs="?", type=Path, default=PICTURE, metavar="FILE")
    drawn(given.parse_args().file)
    return 0
