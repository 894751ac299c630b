"""The guard's reasons as sentences: what was asked, what is commanded, why, and what helps."""

from __future__ import annotations

from dataclasses import dataclass, replace

from controller.guard_types import Decision, GuardSettings, Situation

_WORTH_NAMING = 1.02  # a remedy that gives less is not worth a sentence

_MEANING = {
    "linear": "sum of the damping over sum of the delay",
    "exact": "above it the loop oscillates and grows",
    "one_sided": "above it a wall that never pulls returns the device faster than it came",
    "quantisation": "above it one encoder count commands too much of the torque limit",
    "passive": "above it some passive hand makes the wall unstable",
}


@dataclass(frozen=True, slots=True)
class DelayParts:
    """What the total delay is made of [s]."""

    period: float
    inserted: float
    sample_age: float
    device: float

    @property
    def delay(self) -> float:
        """t_d: all but the hold."""
        return self.inserted + self.sample_age + self.device

    @property
    def total(self) -> float:
        """Half a period for the hold, and t_d: what the stiffness is divided by."""
        return self.period / 2 + self.delay

    def largest(self) -> tuple[str, float]:
        """Name and size of the largest part; the period counts half."""
        sizes = {
            "sample_age": self.sample_age,
            "inserted": self.inserted,
            "device": self.device,
            "period": self.period / 2,
        }
        name = max(sizes, key=lambda each: sizes[each])
        return name, sizes[name]

    def half_of_largest(self) -> DelayParts:
        """The same with the largest part halved."""
        name, _ = self.largest()
        halved = {name: getattr(self, name) / 2}
        return replace(self, **halved)


@dataclass(frozen=True, slots=True)
class Remedy:
    """What one change would allow."""

    change: str
    """``delay`` (its largest part halved), ``damping`` (twice), ``belief`` (no bounds)"""
    stiffness: float
    """That could then be commanded, the one asked for at most [N·m/rad]"""


def explain(
    decision: Decision,
    settings: GuardSettings,
    situation: Situation,
    parts: DelayParts,
    remedies: list[Remedy],
) -> tuple[str, ...]:
    """Sentences for a person, in order of importance; none where all that was asked is commanded.

    Args:
        decision: The decision to explain.
        settings: The guard's settings.
        situation: What the wall is rendered on.
        parts: What its delay is made of.
        remedies: What the changes would allow; empty where K is not bound.
    """
    if settings.mode == "off":
        return _off(decision)
    reasons = [*_stiffness(decision, situation, settings), *_damping(decision, settings, situation)]
    for remedy in remedies:
        if remedy.stiffness > _WORTH_NAMING * decision.stiffness:
            sentence = _remedy(remedy, situation, parts)
            if sentence:
                reasons.append(sentence)
    reasons.extend(_two_sided(decision))
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


def _stiffness(decision: Decision, situation: Situation, settings: GuardSettings) -> list[str]:
    if decision.binding is None:
        return []
    limit = decision.limits.smallest()[1]
    sentences = [
        f"stiffness {decision.request.stiffness:.4g} N·m/rad was asked, {decision.stiffness:.4g} "
        f"is commanded: {decision.margin:g} of the limit {decision.binding}, {limit:.4g} "
        f"({_MEANING[decision.binding]})"
    ]
    if decision.binding == "quantisation":
        sentences.append(_counts(decision, situation, settings))
    elif limit == 0:
        sentences.append(
            f"no stiffness is allowed at a damping of {decision.damping:.4g} N·m·s/rad and a "
            f"delay of {_ms(decision.delay)}: give the wall virtual damping within "
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


def _damping(decision: Decision, settings: GuardSettings, situation: Situation) -> list[str]:
    asked, given = decision.request.damping, decision.damping
    if given == asked:
        return []
    start = f"damping {asked:.4g} N·m·s/rad was asked, {given:.4g} is commanded"
    if asked < given:
        lowest = situation.belief.damping.low / situation.belief.torque_gain.high
        return [
            f"{start}: at {-lowest:.4g} or below it would take away all the damping the servo "
            f"has, and no stiffness is stable"
        ]
    above = "the wall is not passive" if settings.mode == "passive" else "no stiffness is stable"
    return [
        f"{start}: {settings.damping_cap:g} of the ceiling {decision.damping_ceiling:.4g}, above "
        f"which {above} at a delay of {_ms(decision.delay)}"
    ]


def _remedy(remedy: Remedy, situation: Situation, parts: DelayParts) -> str:
    could = f"K could be about {remedy.stiffness:.2g}"
    belief = situation.belief
    if remedy.change == "delay":
        return _shorter(parts, could)
    if remedy.change == "damping":
        low = belief.damping.low
        return (
            f"with twice the viscous damping, {2 * low:.3g} instead of the {low:.3g} N·m·s/rad "
            f"it has at least, {could}"
        )
    return (
        f"the belief is wide: were the servo known to be as its believed values say (inertia "
        f"{belief.inertia.value:.3g} kg·m², damping {belief.damping.value:.3g} N·m·s/rad, delay "
        f"{_ms(belief.delay.value)}, torque gain {belief.torque_gain.value:.3g}), {could}"
    )


def _shorter(parts: DelayParts, could: str) -> str:
    name, size = parts.largest()
    share = f"{100 * size / parts.total:.0f} % of the total delay"
    total = f"(period/2 + delay = {_ms(parts.total)})"
    if name == "period":
        return f"half the period is {share} {total}: at a period of {_ms(parts.period / 2)} {could}"
    what = {
        "sample_age": "the sample's age",
        "inserted": "the inserted delay",
        "device": "the device's own delay, at most",
    }[name]
    return f"{what} {_ms(size)} is {share} {total}: at {_ms(size / 2)} {could}"


def _two_sided(decision: Decision) -> list[str]:
    """What a wall that also pulls would be allowed."""
    if decision.binding != "one_sided":
        return []
    limits = decision.limits
    others = replace(limits, one_sided=None).smallest()[1]
    allowed = min(decision.margin * others, decision.request.stiffness)
    if allowed <= _WORTH_NAMING * decision.stiffness:
        return []
    return [f"a two-sided wall, which also pulls, could have K {allowed:.3g}"]


def _ms(seconds: float) -> str:
    return f"{1e3 * seconds:.3g} ms"
