"""Describes a trial as one printable value that can be run again, and the rows of the tables."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from haptic_wall.controller.detector.tuning import TUNING, Tuning
from scripts.trials.draws import LAG_FACTOR, Bench, bench_of, draw_lag, draw_truth, natural_hz
from scripts.trials.operators import NOBODY, Operator, draw_operator, operator_of
from scripts.trials.run import Trial, WallAsked, run_trial
from scripts.trials.truth import BackEmf, Truth

PRESETS = ("xm430-w350", "xl330-m288")
DAMPINGS = {
    "xm430-w350": (0.005, 0.02, 0.04, 0.1, 0.2),
    "xl330-m288": (0.001, 0.0025, 0.005, 0.01, 0.02),
}
"""Virtual damping of the tried walls [N·m·s/rad]"""
KICKS = (0.02, 0.5)
"""Range of the initial displacement [rad]"""


@dataclass(frozen=True, slots=True)
class Row:
    """Properties of a servo in addition to its rigid body."""

    name: str
    back_emf: BackEmf | None = "none"
    """None: drawn"""
    backlash: bool = False
    flexible: bool = False


ROWS = (
    Row("plain"),
    Row("back-EMF, current mode", back_emf="current"),
    Row("back-EMF, voltage mode", back_emf="voltage"),
    Row("backlash", backlash=True),
    Row("two masses", flexible=True),
    Row("all of them", back_emf=None, backlash=True, flexible=True),
)


@dataclass(frozen=True, slots=True)
class Lags:
    """A range of lags, as multiples of the believed upper bound [1]."""

    name: str
    low: float
    high: float


LAGS = (
    Lags("within", 0.0, 1.0),
    Lags("1 to 2 times", 1.0, 2.0),
    Lags("2 to 4 times", 2.0, LAG_FACTOR),
)


@dataclass(frozen=True, slots=True)
class Case:
    """All parameters of a trial: its printed text can be run again."""

    preset: str
    truth: Truth
    wall: WallAsked
    duration_s: float = 8.0
    position: float = 0.0
    """Initial displacement of the shaft [rad]"""
    push: float = 0.0
    """Constant torque on the output [N·m]"""
    operator: str = "none"
    """Kind of operator, see ``draw_operator``; not with a push"""
    seed: int = 0
    """Seed of the operator"""
    stiffness_hz: float = 3.0
    """Natural frequency of the wall, for a resonant operator [Hz]"""
    velocity: float = 0.0
    """Initial velocity of the shaft [rad/s]"""
    struck: float = 0.0
    """Initial velocity that the load behind a transmission has in addition [rad/s]"""
    law: tuple[str, ...] = ()
    """Settings of another law than a wall, as changes of a configuration"""

    def moved_by(self) -> Operator:
        """Return the operator that moves the output."""
        if self.push:
            return operator_of(0.0, 0.0, np.zeros(round(self.duration_s * 1e3)), push=self.push)
        if self.operator == "none":
            return NOBODY
        return draw_operator(
            self.operator,
            self.truth.inertia,
            self.duration_s,
            np.random.default_rng(self.seed),
            natural_hz=self.stiffness_hz,
        )

    def run(
        self,
        answer: str = "reduce",
        operator: Operator | None = None,
        *,
        speed_limits: bool = False,
        tuning: Tuning = TUNING,
    ) -> Trial:
        """Run the trial.

        Args:
            answer: To an oscillation: ``report``, ``reduce`` or ``trip``.
            operator: Moves the output; None: the case's own.
            speed_limits: The run may trip at the servo's speed, as it does by default; else only
                the detector ends it.
            tuning: Numbers of the detector.
        """
        limits = ("safety.max_speed=null",) if speed_limits else ()
        return run_trial(
            self.truth,
            (*bench_of(self.preset).sets, f"safety.on_oscillation={answer}", *limits, *self.law),
            self.wall,
            self.moved_by() if operator is None else operator,
            duration_s=self.duration_s,
            position=self.position,
            velocity=self.velocity,
            struck=self.struck,
            tuning=tuning,
        )


def draw_row(bench: Bench, row: Row, lags: Lags, random: np.random.Generator) -> Truth:
    """Draw a servo of a row from the whole belief, with its lag from a range.

    Half of the lags are at the upper end of the range.
    """
    truth = draw_truth(
        bench, random, back_emf=row.back_emf, backlash=row.backlash, flexible=row.flexible
    )
    return replace(truth, delay=draw_lag(bench, (lags.low, lags.high), random))


def draw_damping(preset: str, random: np.random.Generator) -> float:
    """Draw one of ``DAMPINGS`` [N·m·s/rad]."""
    return float(random.choice(DAMPINGS[preset]))


def draw_kick(random: np.random.Generator) -> float:
    """Draw log-uniformly within ``KICKS`` [rad]."""
    return log_uniform(KICKS, random)


def log_uniform(ends: tuple[float, float], random: np.random.Generator) -> float:
    """Draw log-uniformly; both ends > 0."""
    low, high = ends
    return float(math.exp(random.uniform(math.log(low), math.log(high))))


def hand_case(
    preset: str, truth: Truth, wall: WallAsked, operator: str, seed: int, duration_s: float
) -> Case:
    """Return a case in which an operator holds the output."""
    return Case(
        preset,
        truth,
        wall,
        duration_s,
        operator=operator,
        seed=seed,
        stiffness_hz=natural_hz(truth, wall.stiffness),
    )
