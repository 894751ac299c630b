"""Measures and computes the stable walls of a servo: a bare horn, a link, a link and a notch.

    scripts/study flexible_figure [--points N] [--quick]

Theory: the exact boundary of two masses. Simulation: both masses without friction and rounding,
stiffer and stiffer walls until the motion grows. Sweep: the program's own experiments on a
simulated servo with friction and encoder, on the simulated clock.
"""

from __future__ import annotations

import math
import tempfile
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from haptic_wall.controller.experiments.sweep.ceiling import CeilingSearch
from haptic_wall.controller.experiments.sweep.critical import PointSearch
from haptic_wall.controller.experiments.sweep.plan import Options, PlanePoint
from haptic_wall.controller.experiments.testbed import Testbed
from haptic_wall.controller.laws.velocity import Biquad
from haptic_wall.controller.report import style
from haptic_wall.controller.settings.load import load_config
from haptic_wall.controller.theory.flexible import flexible_boundary, flexible_ceiling
from haptic_wall.controller.theory.velocity_filter import VelocityFilter
from haptic_wall.hw.plant.body import PlantParameters, State
from haptic_wall.hw.plant.masses import Masses
from haptic_wall.hw.settings import TrueServo
from scripts.study import Found, Option, Part, Study, table

PERIOD, DELAY = 1e-3, 1e-3
MOTOR, FRICTION, COULOMB = 0.011951, 0.011692, 0.002
"""Of an MX-64, but its Coulomb friction, which makes limits depend on the kick"""


class Load(NamedTuple):
    """A load on the servo."""

    name: str
    inertia: float
    stiffness: float
    ratio: float
    dampings: tuple[float, ...]
    colour: str
    notch_q: float = 0.0
    """Quality of a notch of the velocity at the vibration; 0: none"""

    @property
    def transmission(self) -> tuple[float, float]:
        """Return stiffness and damping of the transmission."""
        moving = MOTOR * self.inertia / (MOTOR + self.inertia)
        return self.stiffness, 2.0 * self.ratio * math.sqrt(self.stiffness * moving)

    @property
    def servo(self) -> tuple[float, float, float, float, float]:
        """Return the first arguments of the theory's functions of two masses."""
        return (MOTOR, FRICTION, self.inertia, *self.transmission)

    @property
    def velocity_filter(self) -> VelocityFilter | None:
        """Return the filter of the velocity."""
        if self.notch_q == 0.0:
            return None
        return VelocityFilter("notch", math.tau * self.hertz * PERIOD, self.notch_q)

    @property
    def filter_settings(self) -> list[str]:
        """Return the settings of that filter."""
        if self.notch_q == 0.0:
            return []
        return [
            "wall.velocity_filter=notch",
            f"wall.velocity_hz={self.hertz}",
            f"wall.velocity_q={self.notch_q}",
        ]

    @property
    def hertz(self) -> float:
        """Return the frequency of the vibration [Hz]."""
        ease = 1.0 / MOTOR + 1.0 / self.inertia
        return math.sqrt(self.stiffness * ease) / math.tau


LOADS = (
    Load("a bare horn", 1e-4, 200.0, 0.02, (0.0, 0.04, 0.08, 0.12, 0.16, 0.2), style.BLUE),
    Load(
        "a horn with a link", 0.003, 200.0, 0.02, (0.0, 0.04, 0.08, 0.12, 0.16, 0.18), style.ORANGE
    ),
    Load(
        "a link and a notch", 0.003, 200.0, 0.02, (0.0, 0.06, 0.12, 0.2, 0.3, 0.5), style.GREEN, 0.7
    ),
)
LAST = 0.55
"""Last virtual damping of the picture"""


class Point(NamedTuple):
    """One point of the boundary, or with the stiffness 0 the ceiling."""

    damping: float
    stiffness: float
    error: float
    """Standard error, of the stiffness or of the ceiling"""
    exact: float
    """By theory"""
    note: str


Case = tuple[int, str, float]
"""Number of the load, way, virtual damping"""


def cases(points: int) -> list[Case]:
    """Return the cases to simulate and to measure, at ``points`` dampings of each load."""
    found: list[Case] = []
    for number, load in enumerate(LOADS):
        dampings = load.dampings[:: max(1, len(load.dampings) // points)]
        found += [(number, way, b) for way in ("simulation", "sweep") for b in dampings]
        found.append((number, "ceiling", 0.0))
    return found


def point(case: Case) -> Point:
    """Compute or measure one point."""
    number, way, damping = case
    load = LOADS[number]
    servo = load.servo
    if way == "ceiling":
        exact = float(flexible_ceiling(*servo, PERIOD, DELAY, velocity_filter=load.velocity_filter))
        with tempfile.TemporaryDirectory() as folder:
            found = CeilingSearch(Testbed(_config(load), Path(folder)), 0).run()
        if found.measured is None:
            return Point(math.nan, 0.0, math.nan, exact, found.reason or "")
        return Point(found.measured, 0.0, found.uncertainty or 0.0, exact, "")
    boundary = flexible_boundary(
        *servo, damping, PERIOD, DELAY, velocity_filter=load.velocity_filter
    )
    exact = float(boundary.stiffness)
    if way == "simulation":
        return Point(damping, _simulated(load, damping), 0.0, exact, "")
    with tempfile.TemporaryDirectory() as folder:
        setting, options = PlanePoint(damping, 0), Options(kick=None, repeats=1, tolerance=0.01)
        measured = PointSearch(Testbed(_config(load), Path(folder)), setting, options).run()
    if measured.measured is None:
        return Point(damping, math.nan, math.nan, exact, measured.reason or "")
    error = measured.uncertainty or 0.0
    return Point(damping, measured.measured, error, exact, measured.reason or "")


def _config(load: Load) -> Any:  # noqa: ANN401 - a Config
    stiffness, damping = load.transmission
    return load_config(
        "simulated",
        [
            "loop.clock=simulated",
            "wall.side=both",
            "servo.hand=none",
            f"servo.delay={DELAY}",
            f"servo.inertia={MOTOR}",
            f"servo.damping={FRICTION}",
            f"servo.coulomb={COULOMB}",
            f"servo.load_inertia={load.inertia}",
            f"servo.transmission_stiffness={stiffness}",
            f"servo.transmission_damping={damping}",
            *load.filter_settings,
        ],
    ).config


def _simulated(load: Load, damping: float) -> float:
    """Return the stiffness from which on the motion of both masses grows, by halving."""
    low, high = 0.0, 400.0
    for _ in range(14):
        middle = 0.5 * (low + high)
        low, high = (low, middle) if _grows(load, middle, damping) else (middle, high)
    return 0.5 * (low + high)


def _grows(load: Load, stiffness: float, damping: float) -> bool:
    transmission = load.transmission
    true = TrueServo(
        inertia=MOTOR,
        damping=FRICTION,
        coulomb=0.0,
        load_inertia=load.inertia,
        transmission_stiffness=transmission[0],
        transmission_damping=transmission[1],
    )
    plant, parameters = Masses(true), PlantParameters(MOTOR, FRICTION, 0.0)
    motor = output = State(0.01, 0.0)
    before, waiting, energies = output.position, 0.0, []
    notch = None if load.velocity_filter is None else Biquad(load.velocity_filter.taps())
    for _ in range(3000):
        velocity = (output.position - before) / PERIOD
        velocity = velocity if notch is None else notch.update(velocity)
        torque = -stiffness * output.position - damping * velocity
        before = output.position
        # The torque of the sample a period ago acts.
        motor, output = plant.step((motor, output), parameters, waiting, round(PERIOD * 1e9))
        waiting = torque
        twist = motor.position - output.position
        energies.append(
            MOTOR * motor.velocity**2
            + load.inertia * output.velocity**2
            + stiffness * output.position**2
            + load.stiffness * twist**2
        )
        if energies[-1] > 1e6 * energies[0]:
            return True
    return max(energies[-600:]) > max(energies[600:1200])


def lines(found: Found[Case, Point]) -> list[str]:
    """The picture, and a table of all points."""
    draw(found)
    rows = []
    for (number, way, _), row in found:
        kind = LOADS[number].name
        if way == "ceiling":
            cells = ("ceiling", f"{row.damping:.3f} ± {row.error:.3f}", f"{row.exact:.3f}")
            if math.isnan(row.damping):
                cells = ("ceiling", "none found", f"{row.exact:.3f}")
            rows.append((kind, "sweep", *cells, row.note))
            continue
        value = "none" if math.isnan(row.stiffness) else f"{row.stiffness:.1f}"
        value += f" ± {row.error:.1f}" if row.error > 0.0 else ""
        rows.append((kind, way, f"{row.damping:g}", value, f"{row.exact:.1f}", row.note))
    head = ("servo", "by", "B [N·m·s/rad]", "found", "theory", "remark")
    return [f"![Critical stiffness over B]({PICTURE})", "", *table(head, *rows)]


PICTURE = "flexible-figure.png"


def draw(found: Found[Case, Point]) -> None:
    """Draw theory, simulation and sweep of each load."""
    damping = np.linspace(0.0, LAST, 400)
    with style.picture(
        Path(__file__).parents[2] / "docs" / "evidence" / PICTURE, style.PAGE, 4.0
    ) as figure:
        ax = figure.subplots()
        for number, load in enumerate(LOADS):
            exact = flexible_boundary(
                *load.servo, damping, PERIOD, DELAY, velocity_filter=load.velocity_filter
            ).stiffness
            ax.plot(damping, exact, color=load.colour, label=f"{load.name}: theory")
            for way, marker, size in (("sweep", "o", 7.0), ("simulation", "x", 4.0)):
                rows = [row for case, row in found if case[:2] == (number, way)]
                ax.errorbar(
                    [row.damping for row in rows],
                    [row.stiffness for row in rows],
                    [2.0 * row.error for row in rows],
                    linestyle=" ",
                    marker=marker,
                    markersize=size,
                    markerfacecolor="none",
                    color=load.colour if way == "sweep" else style.INK,
                    linewidth=0.8,
                    capsize=2,
                    label=f"{load.name}: sweep" if way == "sweep" else _once(number),
                )
            for case, row in found:
                if case[:2] == (number, "ceiling") and math.isfinite(row.damping):
                    ax.axvspan(
                        row.damping - 2.0 * row.error,
                        row.damping + 2.0 * row.error,
                        color=load.colour,
                        alpha=0.25,
                        linewidth=0,
                        label=f"{load.name}: measured ceiling",
                    )
        ax.set_xlim(0.0, LAST)
        ax.set_ylim(bottom=0.0)
        ax.set_xlabel(style.VIRTUAL_DAMPING)
        ax.set_ylabel(style.STIFFNESS)
        ax.legend(loc="upper left")
        style.grid(ax)


def _once(number: int) -> str:
    """Return the label of both simulations for the last of them only."""
    return "simulation" if number + 1 == len(LOADS) else "_simulation"


STUDY = Study(
    "evidence/flexible-figure.md",
    (Part("boundary", lambda given: cases(given.points), point, lines, case_s=8.0),),
    (Option("points", 6, "dampings of each load", quick=2),),
)
