"""Says why a decision commands less than was requested, and what would allow more.

Each reason is a sentence, in order of importance: the binding limit, what was clamped, remedies.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

from haptic_wall.controller.guard.evaluation import count_torque
from haptic_wall.controller.guard.limits import BY_NAME, smallest
from haptic_wall.controller.guard.remedies import SAMPLE_AGE, Remedy, Wall, remedies
from haptic_wall.controller.guard.types import Decision, GuardSettings, Situation
from haptic_wall.controller.guard.work import Work
from haptic_wall.controller.milliseconds import ms

_MOST = 4
"""Largest number of reasons; the best remedies are kept, at least two."""
WORTH_NAMING = 1.02
"""Smallest factor that counts as an improvement: the limits are accurate to about 1 %."""


def explain(
    decision: Decision, settings: GuardSettings, situation: Situation, work: Work | None = None
) -> Decision:
    """Return a decision with its reasons, most important first; none where nothing was clamped.

    This takes several times as long as the decision.

    Args:
        decision: The decision to explain.
        settings: Those that it was made with.
        situation: That which it was made for.
        work: Results of earlier evaluations; None: nothing.
    """
    if settings.mode == "off":
        return replace(decision, reasons=tuple(_off(decision)))
    lag = situation.belief.delay.high
    before = max(decision.delay - lag, 0.0)
    inserted = min(decision.inserted, before)
    parts = {SAMPLE_AGE: before - inserted, "inserted": inserted, "device": lag}
    wall = Wall(decision.request, settings, situation, parts)
    found = [*_stiffness(decision, wall), *_damping(decision, wall)]
    if decision.binding is not None:
        now, known = smallest(decision.limits)[1], work or Work()
        worth = [each for each in remedies(wall, known) if each.stiffness > WORTH_NAMING * now]
        found += [_would_raise(each, decision) for each in worth[: max(2, _MOST - len(found))]]
    return replace(decision, reasons=tuple(found))


def _off(decision: Decision) -> Iterator[str]:
    name, value = smallest(decision.limits)
    yield (
        f"the guard is off: stiffness {decision.stiffness:.4g} N·m/rad and damping "
        f"{decision.damping:.4g} N·m·s/rad are commanded as requested; the smallest limit at "
        f"this damping is {name}, {value:.4g} N·m/rad; an oscillation ends the run"
    )
    exact = decision.limits["exact"]
    if decision.only_friction:
        yield (
            "only friction can keep this wall stable: without friction it is unstable for the "
            "believed servo, so small motion dies and larger motion grows"
        )
    elif exact is not None and decision.stiffness > exact:
        yield (
            "this wall is unstable for the believed servo: any motion grows until the torque "
            "saturates or a safety limit ends the run"
        )


def _stiffness(decision: Decision, wall: Wall) -> Iterator[str]:
    if decision.binding is None:
        return
    value = smallest(decision.limits)[1]
    law = decision.request.law
    where = f" where the law is steepest ({law})" if law else ""
    yield (
        f"the guard allows {decision.stiffness:.4g} instead of {decision.request.stiffness:.4g} "
        f"N·m/rad{where}: {decision.margin:g} of the limit {decision.binding}, {value:.4g} "
        f"({BY_NAME[decision.binding].meaning})"
    )
    if decision.binding == "quantisation":
        if not decision.is_coarse:
            yield _count(decision, wall, decision.damping)
    elif value == 0:
        at = min(decision.damping, decision.request.damping)
        yield (
            f"no stiffness is allowed at a damping of {at:.4g} N·m·s/rad and a "
            f"delay of {ms(decision.delay)}: give the wall {_other_damping(decision, wall)}"
        )


def _other_damping(decision: Decision, wall: Wall) -> str:
    if decision.damping > 0.0:
        return "less virtual damping"
    highest = wall.settings.damping_cap * decision.damping_ceiling
    return f"virtual damping within 0 to {highest:.4g} N·m·s/rad"


def _count(decision: Decision, wall: Wall, damping: float) -> str:
    """Say what one encoder count commands through a damping alone, and what it may command."""
    torque = abs(damping) * count_torque(decision.request, wall.situation)
    allowed = wall.settings.quantisation_share * wall.situation.torque_limit
    return (
        f"one encoder count in one sample commands {torque:.3g} N·m through a damping of "
        f"{damping:.4g} N·m·s/rad, and may command {allowed:.3g} N·m, a fraction of the torque "
        "limit (guard.quantisation_share); a velocity over more samples raises this bound in "
        "proportion"
    )


def _damping(decision: Decision, wall: Wall) -> Iterator[str]:
    asked, given = decision.request.damping, decision.damping
    if given == asked:
        return
    said = f"the guard allows {given:.4g} instead of {asked:.4g} N·m·s/rad: "
    belief = wall.situation.belief
    if decision.is_coarse:
        said += _count(decision, wall, asked)
    elif asked < given:
        lowest = -belief.damping.low / belief.torque_gain.high
        said += (
            "no stiffness is allowed with it"
            if asked > lowest
            else f"at {lowest:.4g} or below it cancels all damping of the servo, and no stiffness "
            "is stable"
        )
    else:
        passive = wall.settings.mode == "passive"
        above = "the wall is not passive" if passive else "no stiffness is stable"
        said += (
            f"{wall.settings.damping_cap:g} of the ceiling {decision.damping_ceiling:.4g}, above "
            f"which {above} at a delay of {ms(decision.delay)}"
        )
        if decision.vibrates:
            said += (
                ": the believed load vibrates on its flexible transmission. An encoder on the"
                " motor's side, or a stiffer horn and link, raises this ceiling"
            )
    yield said


def _would_raise(each: Remedy, decision: Decision) -> str:
    stiffness = min(decision.margin * each.stiffness, decision.request.stiffness)
    return f"with {each.text}, K could be about {float(f'{stiffness:.2g}'):g}"
