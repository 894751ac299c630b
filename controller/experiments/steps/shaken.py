"""Runs torque steps on a servo and fits them; raises if the servo did not respond."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from haptic_wall.controller.errors import HapticWallError
from haptic_wall.controller.experiments.holding import Hold, hold_of
from haptic_wall.controller.experiments.steps.step_check import doubted, fault
from haptic_wall.controller.experiments.steps.step_fit import FEWEST_STEPS, StepFit, fit_steps
from haptic_wall.controller.experiments.steps.step_loads import without_loads
from haptic_wall.controller.experiments.steps.torque_steps import (
    PER_BURST,
    Mode,
    StepPlan,
    good,
    plan_steps,
    rough_lag,
    step_phases,
    steps_of,
)
from haptic_wall.controller.experiments.testbed import Played, Testbed
from haptic_wall.controller.settings.config import Config
from haptic_wall.controller.theory.checks import FloatArray

_LONGEST_LAG = 0.06
"""Longest lag of the search [s], or twice the believed one"""
_MISSING = 0.2
"""Fraction of missing samples above which steps cannot be evaluated"""
_MOVED = 0.05
"""Fraction of the planned travel below which a servo has not moved"""


class ExperimentFailedError(HapticWallError):
    """The servo did not do what an experiment needs; exit status 4."""


@dataclass(frozen=True, slots=True)
class Shaking:
    """Plan of a run of torque steps."""

    plan: StepPlan
    hold: Hold
    delay_steps: int
    bursts: int
    seed: int


@dataclass(frozen=True, slots=True)
class Shaken:
    """Result of a run of torque steps."""

    fit: StepFit
    ages: FloatArray
    """Ages of all samples when their torque was sent [s]"""
    played: Played
    note: str
    """Remark for a person; empty: none"""


def plan_shaking(
    config: Config, torque_limit: float, delay_steps: int, bursts: int, seed: int
) -> Shaking:
    """Plan a run within the belief about the servo.

    Raises:
        UserError: The torque limit does not suffice against friction.
    """
    hold = hold_of(config, torque_limit, delay_steps)
    plan = plan_steps(config, torque_limit, hold)
    return Shaking(plan, hold, delay_steps, bursts, seed)


def shake(bed: Testbed, name: str, shaking: Shaking) -> Shaken:
    """Run the steps and fit them; repeat once if disturbed.

    Args:
        bed: The servo.
        name: Name of the log.
        shaking: Shaking from ``plan_shaking``.

    Raises:
        ExperimentFailedError: The servo did not respond, not as expected, or not as a rigid one.
        ExperimentInterruptedError: A person has ended it.
        ExperimentTrippedError: A trip has ended it.
        ServoError: The servo could not be started.
    """
    try:
        return _shaken(bed, name, shaking)
    except ExperimentFailedError as error:
        bed.tell(f"once more: {error}")
    return _shaken(bed, f"{name}-again", shaking)


def _shaken(bed: Testbed, name: str, shaking: Shaking) -> Shaken:
    plan, config = shaking.plan, bed.config
    phases = step_phases(plan, shaking.hold, shaking.bursts, shaking.seed)
    played = bed.play(name, phases, shaking.delay_steps)
    rows, period = played.rows, config.period_s
    stepping = rows[np.isin(rows["phase"], [i for i, p in enumerate(phases) if not p.stiffness])]
    position: FloatArray = stepping["position"]
    away = float(np.ptp(position)) if stepping.size else 0.0
    if away < _MOVED * plan.travel:
        raise ExperimentFailedError(
            f"the servo does not move: {away:.2g} rad under torque steps of ±{plan.torque:.3g} N·m",
            wanted=f"about {plan.travel:.2g} rad",
            advice="free the shaft if it is blocked, switch the supply on, or correct "
            f"model.inertia and model.coulomb ({played.log})",
        )
    longest = max(_LONGEST_LAG, 2.0 * config.belief().delay.high) + 10 * period
    lag = rough_lag(rows, period, longest)
    mode = Mode.of(config)
    steps = steps_of(rows, phases, config.period_ns, shaking.delay_steps, lag, mode)
    left = bool(np.any(np.abs(position - float(rows["position"][0])) > plan.reach))
    planned = shaking.bursts * PER_BURST
    missing = 1.0 - good(rows).size / rows.size
    out = (
        f"{missing:.0%} of the samples came late or not at all; `haptic-wall doctor` names the"
        " remedy"
        if missing > _MISSING
        else f"the shaft left the ±{plan.reach:.2g} rad that the steps may take: its inertia is"
        " below model.inertia.low, or a load pulls it"
        if left
        else "the shaft moved less than model.inertia and model.coulomb predict"
    )
    if len(steps) < FEWEST_STEPS or len({step.direction for step in steps}) < 2:
        raise ExperimentFailedError(
            f"{len(steps)} of {planned} torque steps can be used",
            wanted=f"at least {FEWEST_STEPS}: {out} ({played.log})",
        )
    fit = fit_steps(steps, lag)
    fit = without_loads(fit)
    if reason := fault(fit, longest):
        raise ExperimentFailedError(reason.followed_by(f" ({played.log})"))
    known = fit.systematic
    fit = doubted(fit)
    notes = []
    if 2 * len(steps) < planned:
        notes.append(f"{len(steps)} of {planned} steps were usable: {out}")
    if fit.systematic > known:
        notes.append(
            "the motion after each step differs a little from that of a rigid servo under a torque"
            " step: with other samples about the steps the lag changes by up to"
            f" {1e3 * fit.systematic:.2g} ms, which its error includes"
        )
    return Shaken(fit, rows["age_ns"] * 1e-9, played, "; ".join(notes))
