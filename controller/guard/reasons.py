"""Writes the guard's reasons as sentences: request, command, binding limit, remedies."""

from __future__ import annotations

from collections.abc import Sequence

from haptic_wall.controller.guard.delay_parts import (
    HOLD,
    SAMPLE_AGE,
    SHORT_TIMER,
    DelayParts,
    ms,
    shorter,
)
from haptic_wall.controller.guard.design import FINER, Change, Improvement
from haptic_wall.controller.guard.types import Decision, GuardSettings, Situation

_MEANING = {
    "linear": "sum of the damping over sum of the delay",
    "exact": "above it the loop oscillates and grows",
    "one_sided": "above it a wall that never pulls returns the device faster than it came",
    "quantisation": "above it one encoder count commands too much of the torque limit",
    "passive": "above it some passive hand makes the wall unstable",
}


REMEDIES: tuple[Change, ...] = (
    "virtual_damping",
    "largest_part",
    "damping",
    "belief",
    "encoder",
    "two_sided",
)
"""Changes that are tried where the stiffness is bound."""

_SENTENCES = 4
"""Largest number of sentences; the best remedies are kept, at least two."""


def explain(
    decision: Decision,
    settings: GuardSettings,
    situation: Situation,
    parts: DelayParts,
    remedies: Sequence[Improvement],
    reduced: bool = False,
) -> tuple[str, ...]:
    """Return sentences for a person, most important first; none where nothing was clamped.

    Args:
        decision: The decision to explain.
        settings: The guard's settings.
        situation: The servo and loop that render the wall.
        parts: The parts of the delay.
        remedies: The improvements, the best first; empty where K is not bound.
        reduced: Something other than the guard commands less.
    """
    if settings.mode == "off":
        return _off(decision)
    verb = "is allowed" if reduced else "is commanded"
    reasons = [
        *_stiffness(decision, situation, settings, verb),
        *_damping(decision, settings, situation, verb),
    ]
    worth = [each for each in remedies if each.buys(decision.limits.smallest()[1])]
    for remedy in worth[: max(2, _SENTENCES - len(reasons))]:
        allowed = min(decision.margin * remedy.stiffness, decision.request.stiffness)
        reasons.append(
            _remedy(
                remedy, f"K could be about {float(f'{allowed:.2g}'):g}", decision, situation, parts
            )
        )
    return tuple(reasons)


def _off(decision: Decision) -> tuple[str, ...]:
    name, least = decision.limits.smallest()
    sentences = [
        f"the guard is off: stiffness {decision.stiffness:.4g} N·m/rad and damping "
        f"{decision.damping:.4g} N·m·s/rad are commanded as asked; the smallest limit at this "
        f"damping is {name}, {least:.4g} N·m/rad"
    ]
    if decision.only_friction:
        sentences.append(
            "stable only because of friction, if at all: without it this wall is unstable for "
            "the believed servo, so small motion dies and larger motion grows"
        )
    elif decision.limits.exact is not None and decision.stiffness > decision.limits.exact:
        sentences.append(
            "this wall is unstable for the believed servo: any motion grows until the torque "
            "saturates or a safety limit ends the run"
        )
    return tuple(sentences)


def _stiffness(
    decision: Decision, situation: Situation, settings: GuardSettings, verb: str
) -> list[str]:
    if decision.binding is None:
        return []
    limit = decision.limits.smallest()[1]
    sentences = [
        f"stiffness {decision.request.stiffness:.4g} N·m/rad was asked, {decision.stiffness:.4g} "
        f"{verb}: {decision.margin:g} of the limit {decision.binding}, {limit:.4g} "
        f"({_MEANING[decision.binding]})"
    ]
    if decision.binding == "quantisation":
        sentences.append(_counts(decision, situation, settings))
    elif limit == 0:
        sentences.append(
            f"no stiffness is allowed at a damping of {decision.damping:.4g} N·m·s/rad and a "
            f"delay of {ms(decision.delay)}: give the wall virtual damping within "
            f"0 to {settings.damping_cap * decision.damping_ceiling:.4g} N·m·s/rad"
        )
    return sentences


def _counts(decision: Decision, situation: Situation, settings: GuardSettings) -> str:
    samples = decision.request.velocity_samples
    step = abs(decision.damping) * situation.position_step / (samples * situation.period)
    allowed = settings.quantisation_share * situation.torque_limit
    sentence = (
        f"one encoder count in one sample commands {step:.3g} N·m through the damping alone, and "
        f"{allowed:.3g} N·m is the share of the torque limit a count may command"
    )
    if decision.damping:
        least = allowed * samples * situation.period / situation.position_step
        sentence += (
            f": only virtual damping below {least:.3g} N·m·s/rad leaves any to the stiffness, or "
            f"in proportion more with a velocity over more than {samples} "
            f"sample{'s' if samples > 1 else ''}"
        )
    return sentence


def _damping(
    decision: Decision, settings: GuardSettings, situation: Situation, verb: str
) -> list[str]:
    asked, given = decision.request.damping, decision.damping
    if given == asked:
        return []
    start = f"damping {asked:.4g} N·m·s/rad was asked, {given:.4g} {verb}"
    if asked < given:
        lowest = situation.belief.damping.low / situation.belief.torque_gain.high
        return [
            f"{start}: at {-lowest:.4g} or below it would take away all the damping the servo "
            f"has, and no stiffness is stable"
        ]
    above = "the wall is not passive" if settings.mode == "passive" else "no stiffness is stable"
    return [
        f"{start}: {settings.damping_cap:g} of the ceiling {decision.damping_ceiling:.4g}, above "
        f"which {above} at a delay of {ms(decision.delay)}"
    ]


def _remedy(
    remedy: Improvement, could: str, decision: Decision, situation: Situation, parts: DelayParts
) -> str:
    belief = situation.belief
    match remedy.change:
        case "largest_part":
            return _shorter(parts, situation.slow_replies, could)
        case "virtual_damping":
            return (
                f"with virtual damping {remedy.damping:.2g} instead of "
                f"{decision.damping:.3g} N·m·s/rad, {could}"
            )
        case "damping":
            low = belief.damping.low
            return (
                f"with twice the viscous damping, {2 * low:.3g} instead of the {low:.3g} "
                f"N·m·s/rad it has at least, {could}"
            )
        case "encoder":
            return f"with an encoder {FINER} times finer, {could}"
        case "two_sided":
            return f"as a two-sided wall, which also pulls, {could}"
        case _:
            return (
                "the belief is wide: were the servo known to be as its believed values say "
                f"(inertia {belief.inertia.value:.3g} kg·m², damping {belief.damping.value:.3g} "
                f"N·m·s/rad, delay {ms(belief.delay.value)}, torque gain "
                f"{belief.torque_gain.value:.3g}), {could}"
            )


def _shorter(parts: DelayParts, slow_replies: bool, could: str) -> str:
    name, size = parts.largest()
    share = f"{100 * size / parts.total:.0f} % of the total delay"
    total = f"(period/2 + delay = {ms(parts.total)})"
    if name == HOLD:
        return f"half the period is {share} {total}: at a period of {ms(parts.period / 2)} {could}"
    what = {
        SAMPLE_AGE: "the sample's age",
        "inserted": "the inserted delay",
        "device": "the device's own delay, at most",
    }[name]
    least = shorter(parts, slow_replies)
    found = f"{what} {ms(size)} is {share} {total}"
    if slow_replies and name == SAMPLE_AGE:
        return (
            f"{found}, because the adapter keeps replies back: with its latency timer at "
            f"{ms(SHORT_TIMER)} the age is at most {ms(least)}, and {could}"
        )
    return f"{found}: at {ms(least)} {could}"
