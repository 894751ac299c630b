"""Asks the guard how stiff a servo may be made to feel, and which limit binds."""

from __future__ import annotations

import math
from bisect import bisect_left
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np

from haptic_wall.controller.experiments.holding import sample_age, torque_limit_of
from haptic_wall.controller.guard.decision_report import decision_report
from haptic_wall.controller.guard.evaluation import Evaluation
from haptic_wall.controller.guard.guard import decide
from haptic_wall.controller.guard.limits import evaluate, least_of
from haptic_wall.controller.guard.plants import Plants
from haptic_wall.controller.guard.reasons import explain
from haptic_wall.controller.guard.schedule import age_bins_ns
from haptic_wall.controller.guard.types import Decision, GuardSettings, Request, Situation
from haptic_wall.controller.settings.config import Config
from haptic_wall.controller.theory.checks import FloatArray

ASKED = 1e6
"""A request above every limit [N·m/rad]"""
_POINTS, _ROUNDS = 65, 4


@dataclass(frozen=True, slots=True)
class GuardQuestion:
    """The request to the guard, with the measured age of the samples."""

    config: Config
    age: float
    """Age of a sample when its torque is sent, as the guard uses it [s]"""
    situation: Situation
    settings: GuardSettings

    @classmethod
    def of(cls, config: Config, age: float | None) -> GuardQuestion:
        """Return the question for a model, and a measured age where there is one.

        Args:
            config: Configuration with the best known model.
            age: Percentile of the samples' ages [s]; None: it is an estimate for the bus.
        """
        step = config.servo.position_step
        age = sample_age(config) if age is None else age
        if config.servo.kind != "simulated" or config.loop.clock != "simulated":
            # A run uses the next larger age of its gain schedule.
            bins = age_bins_ns(config.period_ns)
            age = bins[min(bisect_left(bins, age * 1e9), len(bins) - 1)] * 1e-9
        situation = Situation(
            belief=config.belief(),
            period=config.period_ns * 1e-9,
            torque_limit=torque_limit_of(config),
            position_step=step,
        )
        settings = config.guard_settings()
        if settings.mode == "off":
            settings = replace(settings, mode="stable")
        return cls(config, max(age, config.guard.sample_age), situation, settings)

    @property
    def inserted(self) -> float:
        """Return the inserted delay [s]."""
        return self.config.delay.steps * self.situation.period

    def decide(self, stiffness: float, damping: float) -> Decision:
        """Return the guard's decision on a wall."""
        asked = replace(self.config.request(), stiffness=stiffness, damping=damping)
        situation = replace(self.situation, inserted=(self.inserted, self.inserted))
        (decision,) = decide(asked, self.settings, situation, [self.inserted + self.age])
        return explain(decision, self.settings, situation)

    def walls(self, damping: FloatArray) -> Evaluation:
        """Return the walls over the virtual damping [N·m·s/rad], as it would be commanded."""
        plants = Plants.at_corner(self.situation, np.full(damping.size, self.inserted + self.age))
        request: Request = self.config.request()
        return Evaluation(request, self.settings, self.situation, plants, asked=damping)

    def best_damping(self) -> float:
        """Return the virtual damping >= 0 with the highest allowed stiffness [N·m·s/rad]."""
        low, high = 0.0, float(self.walls(np.array([1e12])).damping[0])
        best = 0.0
        for _ in range(_ROUNDS):
            tried = np.linspace(low, high, _POINTS)
            top = int(np.argmax(least_of(evaluate(self.walls(tried)))))
            best = float(tried[top])
            low, high = tried[max(top - 1, 0)], tried[min(top + 1, _POINTS - 1)]
        return best


def verdict(question: GuardQuestion, identified: bool) -> dict[str, Any]:
    """Return the possible stiffness, its damping, and the binding limit.

    Args:
        question: The servo in its loop.
        identified: The model was measured, not only believed.
    """
    belief = question.situation.belief
    # Rounded down, so that the guard still allows it; stiffness grows with it, so three digits.
    best = _rounded_down(question.best_damping())
    return {
        "basis": "identified" if identified else "believed",
        "margin": question.settings.margin,
        "torque_limit": question.situation.torque_limit,
        "model": {
            name: asdict(getattr(belief, name))
            for name in ("inertia", "damping", "coulomb", "delay", "torque_gain")
        },
        "plain": decision_report(question.decide(ASKED, 0.0)),
        "best": decision_report(question.decide(ASKED, best)),
    }


def _rounded_down(value: float) -> float:
    if value <= 0.0:
        return 0.0
    unit = 10.0 ** (math.floor(math.log10(value)) - 2)
    return float(f"{math.floor(value / unit + 1e-9) * unit:.3g}")
