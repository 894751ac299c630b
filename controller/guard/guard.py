"""Decides which stiffness and damping may be commanded; ``reasons`` explains a decision.

It is a pure computation outside the tick. It first limits the virtual damping to a fraction of the
ceiling above which no stiffness is stable. It then limits the stiffness to ``margin`` times the
smallest limit at that damping. Both use the least safe corner of the belief: lowest inertia and
damping, longest delay, highest torque gain.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from haptic_wall.controller.guard.evaluation import Evaluation
from haptic_wall.controller.guard.limits import BY_NAME, evaluate, smallest
from haptic_wall.controller.guard.plants import Plants
from haptic_wall.controller.guard.types import Decision, GuardSettings, Request, Situation
from haptic_wall.controller.guard.work import Work
from haptic_wall.controller.theory.checks import FloatArray, not_negative


def decide(
    request: Request,
    settings: GuardSettings,
    situation: Situation,
    delays: Sequence[float],
    work: Work | None = None,
) -> list[Decision]:
    """Decide which stiffness and damping may be commanded, for each of several delays.

    Args:
        request: The requested wall.
        settings: The guard's settings.
        situation: The belief about the servo, the period, and its limits.
        delays: Inserted delay and age of the sample, without the device's own lag, each >= 0 [s].
        work: Results of earlier evaluations; None: nothing.

    Returns:
        One decision per delay, in order, without reasons.

    Raises:
        ValueError: A value of the request or situation lies outside its domain; the message names
            it.
    """
    before_device = np.atleast_1d(not_negative("delays", list(delays)))
    corner = Plants.at_corner(situation, before_device)
    at = Evaluation(request, settings, situation, corner, work=work)
    every = evaluate(at)
    alone = np.zeros(before_device.size, dtype=np.bool_)
    if settings.mode == "off":
        alone = _unstable_nominally(request, settings, situation, before_device)
    decisions = []
    for i, delay in enumerate(corner.delay.tolist()):
        limits: dict[str, float | None] = dict.fromkeys(BY_NAME)
        limits |= {name: float(each[i]) for name, each in every.items()}
        name, least_limit = smallest(limits)
        bound = settings.mode != "off" and request.stiffness > settings.margin * least_limit
        damping = float(at.damping[i])
        if settings.mode != "off" and least_limit <= 0.0:
            damping = max(damping, 0.0)  # below 0 it may feed a vibration by itself
        decisions.append(
            Decision(
                request=request,
                delay=delay,
                period=situation.period,
                stiffness=settings.margin * least_limit if bound else request.stiffness,
                damping=damping,
                limits=limits,
                encoder_damping=float(at.encoder_damping[i]),
                damping_ceiling=float(at.ceiling[i]),
                margin=settings.margin,
                binding=name if bound else None,
                reasons=(),
                only_friction=bool(alone[i]) and situation.belief.coulomb.value > 0,
                vibrates=bool(at.vibrates[i]),
                inserted=situation.inserted[1],
            )
        )
    return decisions


def _unstable_nominally(
    request: Request, settings: GuardSettings, situation: Situation, before_device: FloatArray
) -> NDArray[np.bool_]:
    """Whether the requested wall is unstable for the nominal belief without friction."""
    nominal = replace(situation, belief=situation.belief.nominal)
    p = Plants.at_corner(nominal, before_device)
    at = Evaluation(request, settings, nominal, p)
    if request.stiffness > 0:
        unstable: NDArray[np.bool_] = request.stiffness >= at.at_corner(at.exact)
        return unstable
    runs_away: NDArray[np.bool_] = at.damping < -p.damping / p.gain
    return runs_away | (at.damping >= at.rigid_ceiling)
