"""Makes the question of ``haptic-wall boundary`` from its options, or from a configuration."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

from haptic_wall.controller.errors import UserError
from haptic_wall.controller.guard.belief import Belief, Bounded
from haptic_wall.controller.guard.boundary_curve import Load, Question, WallSide
from haptic_wall.controller.guard.types import Situation
from haptic_wall.controller.settings.load import load_config
from haptic_wall.controller.settings.rules import MOST_LOWPASS_Q, MOST_OF_RATE
from haptic_wall.controller.theory.servos import SERVOS, ServoFacts, servo, sister
from haptic_wall.controller.theory.velocity_filter import VelocityFilter
from haptic_wall.hw.names import did_you_mean

LONGEST_PERIOD_S, _LONGEST_DELAY_S = 0.5, 1.0
"""Larger values are probably milliseconds in place of seconds."""
_MOST_PERIODS = 500
"""Longest delay in periods: beyond it each answer takes many seconds."""
_LEAST_Q, _MOST_Q = 0.1, 20.0
"""Qualities of a filter that a configuration may have"""
_WIDEST = 10_000
"""Largest ratio of a range's ends: a wider one is a mistyped number."""
_IN_SI = "give a number in SI units"


def of_config(name: str, sets: tuple[str, ...], given: dict[str, Any]) -> Question:
    """Return the question of a configuration: servo and loop as it believes them to be.

    Raises:
        UserError: The configuration is wrong, or an option asks for something else than it has.
    """
    for option, value in given.items():
        if value is not None and option not in ("delay", "side"):
            raise UserError(
                "CONFIG gives this value",
                field=f"--{option.removesuffix('_name').replace('_', '-')}",
                advice="leave the option out, or change CONFIG with --set",
            )
    config = load_config(name, sets).config
    belief, period = config.belief(), config.period_ns * 1e-9
    delay: Bounded | None = given["delay"]
    if delay is None:
        before = config.delay.steps * period + config.guard.sample_age
        lag = belief.delay
        delay = Bounded(before + lag.value, before + lag.low, before + lag.high)
    _check_delay(delay, period)
    limit = config.servo.torque_limit
    side: WallSide = given["side"] or ("both" if config.wall.side == "both" else "one")
    filtered = config.velocity_filter()
    if filtered is not None and side == "one":
        raise _one_sided(config.wall.velocity_filter)
    return Question(
        situation=Situation(
            replace(belief, delay=delay),
            period,
            limit or 1.0,
            config.servo.position_step if limit else 0.0,
        ),
        side=side,
        velocity_samples=config.wall.velocity_samples,
        velocity_filter=filtered,
    )


def of_options(given: dict[str, Any]) -> Question:
    """Return the question of the options.

    Raises:
        UserError: An option is missing or outside of its domain; the message names it.
    """
    facts = _facts(given["servo_name"])
    period = _period(given["period"], given["rate"])
    delay: Bounded | None = given["delay"]
    if delay is None:
        raise UserError("missing", field="--delay", advice="give it, or give a CONFIG")
    _check_delay(delay, period)
    counts, limit = _encoder(given, facts)
    belief = Belief(
        inertia=_wanted("inertia", given["inertia"], facts, zero=False),
        damping=_wanted("damping", given["damping"], facts, zero=True),
        coulomb=Bounded.exactly(facts.coulomb if facts else 0.0),
        delay=delay,
        torque_gain=_domain(
            "--torque-gain", given["torque_gain"] or Bounded.exactly(1.0), zero=False
        ),
    )
    filtered = _filter(given, period)
    side: WallSide = given["side"] or ("one" if filtered is None else "both")
    if filtered is not None:
        _check_exact(belief, "a filter")
    return Question(
        situation=Situation(belief, period, limit, 2 * math.pi / counts if counts else 0.0),
        side=side,
        velocity_samples=given["velocity_samples"] or 1,
        load=_load(given, belief),
        velocity_filter=filtered,
    )


def _filter(given: dict[str, Any], period: float) -> VelocityFilter | None:
    """Return the filter of the velocity that the options describe; None: there is none."""
    kind, hertz, q = (given[f"velocity_{name}"] for name in ("filter", "hz", "q"))
    if kind in (None, "none"):
        for name, value in (("hz", hertz), ("q", q)):
            if value is not None:
                raise UserError(
                    "there is no filter",
                    field=f"--velocity-{name}",
                    advice="give --velocity-filter too",
                )
        return None
    if given["side"] == "one":
        raise _one_sided(kind)
    if hertz is None:
        raise UserError("missing", field="--velocity-hz", advice="give the filter's frequency")
    most = MOST_OF_RATE / period
    if not 0.0 < hertz < most:
        raise UserError(
            f"wanted more than 0 and less than {most:g} Hz, which is {MOST_OF_RATE:g} of the rate",
            field="--velocity-hz",
            given=f"{hertz:g}",
        )
    q = 0.7 if q is None else q
    top = MOST_LOWPASS_Q if kind == "lowpass" else _MOST_Q
    if not _LEAST_Q <= q <= top:
        raise UserError(
            f"wanted {_LEAST_Q:g} to {top:g} for a {kind}", field="--velocity-q", given=f"{q:g}"
        )
    return VelocityFilter(kind, math.tau * hertz * period, q)


def _one_sided(kind: str) -> UserError:
    return UserError(
        "the limit of a one-sided wall with a velocity filter is not known",
        field="--side",
        given=f"one, {kind}",
        wanted="both",
    )


def _check_delay(delay: Bounded, period: float) -> None:
    if delay.low < 0 or delay.high > _LONGEST_DELAY_S:
        raise UserError(
            f"wanted 0 to {_LONGEST_DELAY_S:g} s",
            field="--delay",
            given=_span(delay),
            advice="give seconds: 2 ms is 0.002",
        )
    if delay.high > _MOST_PERIODS * period:
        raise UserError(
            f"{delay.high / period:.4g} periods of {period:g} s",
            field="--delay",
            given=_span(delay),
            wanted=f"at most {_MOST_PERIODS}",
            advice="check the period",
        )


def _load(given: dict[str, Any], belief: Belief) -> Load | None:
    """Return the load that the options describe; None: there is none."""
    inertia, stiffness = given["load_inertia"], given["transmission_stiffness"]
    damping, encoder = given["transmission_damping"], given["encoder"]
    if inertia is None and stiffness is None:
        if damping is None and encoder is None:
            return None
        option = "--transmission-damping" if damping is not None else "--encoder"
        raise UserError(
            "there is no load",
            field=option,
            advice="give --load-inertia and --transmission-stiffness too",
        )
    for option, value in (
        ("--load-inertia", inertia),
        ("--transmission-stiffness", stiffness),
    ):
        if value is None:
            raise UserError(
                "missing",
                field=option,
                advice="give both --load-inertia and --transmission-stiffness",
            )
    damping = 0.0 if damping is None else damping
    _check_exact(belief)
    if not (belief.damping.low > 0 or damping > 0):
        raise UserError(
            "servo and load have no damping",
            field="--damping",
            given="0",
            advice="give --damping or --transmission-damping",
        )
    return Load(inertia, stiffness, damping, encoder or "output")


def _check_exact(belief: Belief) -> None:
    """Refuse ranges, for which no limits are known with a load."""
    for name in ("inertia", "damping", "delay", "torque_gain"):
        bounds: Bounded = getattr(belief, name)
        if bounds.low < bounds.high:
            raise UserError(
                "with a load a range has no least safe corner",
                field=f"--{name.replace('_', '-')}",
                given=_span(bounds),
                advice="give one number, and run the command once for each end of the range",
            )


def _facts(name: str | None) -> ServoFacts | None:
    if name is None:
        return None
    found = servo(name)
    if found is not None:
        return found
    alike = sister(name)
    if alike is not None:
        raise UserError(
            f"inertia and friction of the {alike[0]} are not published",
            field="--servo",
            advice=f"choose the similar {alike[1]}, or give inertia and damping as numbers",
        )
    near = did_you_mean(name.upper(), SERVOS, likeness=0.5)
    choose = f"{near} Choose" if near else "choose"
    raise UserError(
        f"servo {name!r} is not known",
        field="--servo",
        advice=f"{choose} one of {', '.join(SERVOS)}, or give inertia and damping as numbers",
    )


def _period(period: float | None, rate: float | None) -> float:
    if period is not None and rate is None:
        return period
    if rate is not None and period is None:
        return 1 / rate
    raise UserError(
        f"found {'neither' if period is None else 'both'}",
        field="--period",
        given="and --rate",
        wanted="one of them",
        advice="give --period 0.001 or --rate 1000",
    )


def _wanted(name: str, given: Bounded | None, facts: ServoFacts | None, zero: bool) -> Bounded:
    if given is not None:
        return _domain(f"--{name}", given, zero)
    if facts is None:
        raise UserError(
            "missing", field=f"--{name}", advice="give it, or name a servo with --servo MX-64"
        )
    return Bounded.exactly(getattr(facts, name))


def _domain(option: str, given: Bounded, zero: bool) -> Bounded:
    if given.low < 0 or (given.low == 0 and not zero):
        wanted = "0 or more" if zero else "more than 0"
        raise UserError(f"wanted {wanted}", field=option, given=_span(given), advice=_IN_SI)
    if given.high > _WIDEST * given.low > 0:
        raise UserError(
            f"the upper end is {given.high / given.low:.3g} times the lower end",
            field=option,
            given=_span(given),
            wanted=f"at most {_WIDEST} times",
            advice="give a narrower range, in SI units",
        )
    return given


def _encoder(given: dict[str, Any], facts: ServoFacts | None) -> tuple[float, float]:
    """Return counts per turn (0: the encoder is not counted) and torque limit [N·m]."""
    counts, limit = given["counts_per_rev"], given["torque_limit"]
    if counts is None and facts is not None:
        counts = facts.counts_per_rev
    if limit is None:
        if given["counts_per_rev"] is not None:
            raise UserError(
                "the quantisation limit needs the torque limit too",
                field="--counts-per-rev",
                advice="give --torque-limit",
            )
        return 0.0, 1.0
    if counts is None:
        raise UserError(
            "the quantisation limit needs the encoder's counts too",
            field="--torque-limit",
            advice="give --counts-per-rev",
        )
    return counts, limit


def _span(value: Bounded) -> str:
    return f"{value.low:g}" if value.low == value.high else f"{value.low:g}:{value.high:g}"
