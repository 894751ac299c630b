"""Formats the reasons of a guard decision as sentences: binding limit, clamps and remedies."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace

from haptic_wall.controller.guard.delay_parts import HOLD, SAMPLE_AGE, SHORT_TIMER, ms, shorter
from haptic_wall.controller.guard.design import FINER
from haptic_wall.controller.guard.reasons import (
    CoarseCount,
    CoarseDamping,
    DampingBound,
    DampingTooLow,
    Derated,
    FromTank,
    GuardOff,
    LimitName,
    NothingAllowed,
    Reason,
    ServedSlower,
    StiffnessBound,
    Unstable,
    WaitsForRest,
    WouldRaise,
)

MEANING: dict[LimitName, str] = {
    LimitName.LINEAR: "sum of the damping over sum of the delay",
    LimitName.EXACT: "above it the loop oscillates and grows",
    LimitName.ONE_SIDED: (
        "above it a wall that never pulls returns the device faster than it came"
    ),
    LimitName.QUANTISATION: "above it one encoder count commands too much of the torque limit",
    LimitName.BACKLASH: (
        "above it the believed backlash may sustain an oscillation that friction does not stop"
    ),
    LimitName.FLEXIBLE: "above it the believed load may vibrate on its flexible transmission",
    LimitName.RESOLUTION: "above it friction slips before the encoder has seen it bend",
    LimitName.PASSIVE: "above it some passive hand makes the wall unstable",
}


def sentences(
    reasons: Iterable[Reason], asked: bool = True, now: tuple[float, float] | None = None
) -> list[str]:
    """Return the reasons as sentences for a person.

    Args:
        reasons: In order.
        asked: Name the requested stiffness; no if any was requested.
        now: Stiffness [N·m/rad] and damping [N·m·s/rad] that are really commanded; None: not known.
    """
    return [
        _sentence(reason, asked) if now is None else _with_number(reason, asked, *now)
        for reason in reasons
    ]


def _with_number(reason: Reason, asked: bool, stiffness: float, damping: float) -> str:
    """Return a sentence that begins with what is really commanded, where that differs."""
    match reason:
        case StiffnessBound():
            now, unit = f"{stiffness:.4g}", "N·m/rad"
        case DampingBound() | DampingTooLow() | CoarseDamping():
            now, unit = f"{damping:.4g}", "N·m·s/rad"
        case _:
            return _sentence(reason, asked)
    same = now == f"{reason.allowed:.4g}"
    said = _sentence(replace(reason, commanded=same), asked)
    if same:
        return said
    falls = ", on its way down" if float(now) > reason.allowed else ""
    return f"the wall has {now} {unit} at the end{falls}; {said}"


def _sentence(reason: Reason, asked: bool) -> str:
    match reason:
        case StiffnessBound():
            said = _stiffness(reason, asked)
        case CoarseCount():
            said = _coarse_count(reason)
        case NothingAllowed():
            said = (
                f"no stiffness is allowed at a damping of {reason.damping:.4g} N·m·s/rad and a "
                f"delay of {ms(reason.delay)}: give the wall virtual damping within "
                f"0 to {reason.highest_damping:.4g} N·m·s/rad"
            )
        case DampingTooLow():
            said = (
                f"{_damping(reason)}: at {reason.lowest:.4g} or below it cancels all damping of "
                "the servo, and no stiffness is stable"
            )
        case DampingBound() | CoarseDamping():
            said = _damping_bound(reason)
        case WouldRaise():
            said = _remedy(reason)
        case GuardOff():
            said = (
                f"the guard is off: stiffness {reason.stiffness:.4g} N·m/rad and damping "
                f"{reason.damping:.4g} N·m·s/rad are commanded as requested; the smallest limit at "
                f"this damping is {reason.limit}, {reason.value:.4g} N·m/rad"
            )
        case Unstable():
            said = _unstable(reason)
        case ServedSlower():
            said = _slower(reason)
        case Derated():
            said = (
                f"an oscillation of {reason.frequency_hz:.3g} Hz was found after "
                f"{reason.first_alarm_s:.3g} s: the stiffness is reduced to "
                f"{100 * reason.stiffness_share:.3g} % and the damping to "
                f"{100 * reason.damping_share:.3g} % of the values that the guard allows, until "
                "the full wall is requested"
            )
        case WaitsForRest():
            said = (
                f"{reason.allowed:.4g} N·m/rad are allowed, but K rises only at positions where "
                "this adds at most safety.engage_torque, and the shaft has not been there since"
            )
        case FromTank():
            said = (
                f"{reason.law} depends on time, and gives only absorbed energy: it absorbed "
                f"{reason.absorbed * 1e3:.3g} mJ and gave at most {reason.given * 1e3:.3g} mJ; its "
                f"tank limited the torque in {reason.limited} ticks"
            )
    return said


def _unstable(reason: Unstable) -> str:
    if reason.only_friction:
        return (
            "only friction can keep this wall stable: without friction it is unstable for the "
            "believed servo, so small motion dies and larger motion grows"
        )
    return (
        "this wall is unstable for the believed servo: any motion grows until the torque "
        "saturates or a safety limit ends the run"
    )


def _verb(commanded: bool) -> str:
    return "commands" if commanded else "allows"


def _stiffness(reason: StiffnessBound, asked: bool) -> str:
    instead = f" instead of {reason.asked:.4g}" if asked else ""
    where = f" where the law is steepest ({reason.law})" if reason.law else ""
    return (
        f"the guard {_verb(reason.commanded)} {reason.allowed:.4g}{instead} N·m/rad{where}: "
        f"{reason.margin:g} of the limit {reason.limit}, {reason.value:.4g} "
        f"({MEANING[reason.limit]})"
    )


def _coarse_count(reason: CoarseCount) -> str:
    said = (
        f"one encoder count in one sample commands {reason.torque:.3g} N·m through the damping "
        f"alone, and a count may command {reason.allowed:.3g} N·m, a fraction of the torque limit "
        "(guard.quantisation_share)"
    )
    if reason.highest_damping is None:
        return said
    return (
        f"{said}: only virtual damping below {reason.highest_damping:.3g} N·m·s/rad leaves torque "
        f"for the stiffness; {_more_samples(reason.samples)}"
    )


def _coarse_damping(reason: CoarseDamping) -> str:
    return (
        f"{_damping(reason)}: one encoder count in one sample would command {reason.torque:.3g} "
        f"N·m, and may command {reason.most:.3g} N·m, a fraction of the torque limit; "
        f"{_more_samples(reason.samples)}"
    )


def _more_samples(samples: int) -> str:
    return (
        f"a velocity over more than {samples} sample{'s' if samples > 1 else ''} raises this bound "
        "in proportion"
    )


def _damping(reason: DampingTooLow | DampingBound | CoarseDamping) -> str:
    return (
        f"the guard {_verb(reason.commanded)} {reason.allowed:.4g} instead of {reason.asked:.4g} "
        "N·m·s/rad"
    )


def _damping_bound(reason: DampingBound | CoarseDamping) -> str:
    if isinstance(reason, CoarseDamping):
        return _coarse_damping(reason)
    above = "the wall is not passive" if reason.passive else "no stiffness is stable"
    said = (
        f"{_damping(reason)}: {reason.share:g} of the ceiling {reason.ceiling:.4g}, above "
        f"which {above} at a delay of {ms(reason.delay)}"
    )
    if not reason.vibrates:
        return said
    return (
        f"{said}: the believed load vibrates on its flexible transmission. An encoder on the"
        " motor's side, or a stiffer horn and link, raises this ceiling"
    )


def _remedy(reason: WouldRaise) -> str:
    could = f"K could be about {float(f'{reason.stiffness:.2g}'):g}"
    belief = reason.belief
    match reason.improvement.change:
        case "largest_part":
            return _shorter(reason, could)
        case "virtual_damping":
            return (
                f"with virtual damping {reason.improvement.damping:.2g} instead of "
                f"{reason.damping:.3g} N·m·s/rad, {could}"
            )
        case "damping":
            low = belief.damping.low
            return (
                f"with twice the viscous damping, {2 * low:.3g} instead of at least {low:.3g} "
                f"N·m·s/rad, {could}"
            )
        case "encoder":
            return f"with an encoder {FINER} times finer, {could}"
        case "two_sided":
            return f"as a two-sided wall, which also pulls, {could}"
        case "motor_encoder":
            return f"with an encoder on the motor's side of the flexible transmission, {could}"
        case "stiffer":
            frequency = 2.0 * belief.flexible_hz.low
            return (
                "with a stiffer horn and link, whose vibration has twice the frequency, at least "
                f"{frequency:.3g} Hz, {could}"
            )
        case _:
            return (
                "the parameter bounds are wide: if the servo had exactly the believed values "
                f"(inertia {belief.inertia.value:.3g} kg·m², damping {belief.damping.value:.3g} "
                f"N·m·s/rad, delay {ms(belief.delay.value)}, torque gain "
                f"{belief.torque_gain.value:.3g}), {could}"
            )


def _shorter(reason: WouldRaise, could: str) -> str:
    parts = reason.parts
    name, size = parts.largest()
    share = f"{100 * size / parts.total:.0f} % of the total delay"
    total = f"(period/2 + delay = {ms(parts.total)})"
    if name == HOLD:
        return f"half the period is {share} {total}: at a period of {ms(parts.period / 2)} {could}"
    what = {
        SAMPLE_AGE: "the sample's age",
        "inserted": "the inserted delay",
        "device": "the device's lag of at most",
    }[name]
    least = shorter(parts, reason.slow_replies)
    found = f"{what} {ms(size)} is {share} {total}"
    if reason.slow_replies and name == SAMPLE_AGE:
        return (
            f"{found}, because the adapter holds back replies: with its latency timer at "
            f"{ms(SHORT_TIMER)} the age is at most {ms(least)}, and {could}"
        )
    return f"{found}: at {ms(least)} {could}"


def _slower(reason: ServedSlower) -> str:
    start = (
        f"every {ms(reason.interval)} instead of every {ms(reason.period)}, which counts as the"
        " period"
    )
    late = "the report's key timing names the causes of late ticks"
    if not reason.failed:
        return f"a tick is executed {start}; {late}"
    check = "cable, power, baud rate and adapter"
    if reason.emulated:
        check = "the emulator's processor time, and injected faults"
    replies = f"{reason.failed} of {reason.cycles} replies were lost or broken"
    if not reason.missed:
        return f"a good reading came {start}: {replies}; check {check}"
    return (
        f"a good reading came {start}: {replies} (check {check}), and"
        f" {reason.missed} periods were missed ({late})"
    )
