"""``haptic-wall boundary``: computes a servo's stiffness limits, and which changes raise them."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any, Final

import click

from haptic_wall.controller.cli.drawing import drawn_or_noted
from haptic_wall.controller.cli.experiment import refuse_unknown
from haptic_wall.controller.cli.numbers import Number
from haptic_wall.controller.cli.options import (
    answer,
    axis_option,
    config_argument,
    json_option,
    set_option,
)
from haptic_wall.controller.cli.places import plot_option
from haptic_wall.controller.cli.working import working
from haptic_wall.controller.errors import UserError
from haptic_wall.controller.guard.belief import Belief, Bounded
from haptic_wall.controller.guard.boundary import (
    Load,
    Question,
    WallSide,
    default_dampings,
    report,
)
from haptic_wall.controller.guard.types import Situation
from haptic_wall.controller.report.boundary_text import boundary_text
from haptic_wall.controller.settings.load import load_axis
from haptic_wall.controller.theory.servos import SERVOS

_MOST_PERIODS: Final = 500
"""Longest delay in periods: beyond it each answer takes many seconds"""
_POSITIVE: Final = Number(0, above=True)


@click.command()
@config_argument(needed=False)
@set_option
@axis_option
@click.option("--servo", type=click.Choice(list(SERVOS), case_sensitive=False),
              help="A servo with published parameters, for what is not given.")  # fmt: skip
@click.option("--inertia", type=_POSITIVE, metavar="M", help="Inertia [kg·m²].")
@click.option("--damping", type=Number(0), metavar="b",
              help="Viscous friction [N·m·s/rad].")  # fmt: skip
@click.option("--period", type=Number(0, 0.5, above=True, unit="s"), metavar="T",
              help="Sampling period [s].")  # fmt: skip
@click.option("--delay", type=Number(0, 1, unit="s"), metavar="td",
              help="Total delay from a sample to its torque [s]. Default with CONFIG: the sum of "
              "inserted delay, guard.sample_age and model.delay.")  # fmt: skip
@click.option("--virtual-damping", "dampings", type=Number(form="list"), metavar="B[,B...]",
              help="Virtual damping of each point [N·m·s/rad]; default: fractions of the "
              "ceiling.")  # fmt: skip
@click.option("--side", type=click.Choice(["one", "both"]),
              help="A one-sided wall never pulls. Default: CONFIG's, or one.")  # fmt: skip
@click.option("--load-inertia", type=_POSITIVE, metavar="J",
              help="Inertia behind a flexible transmission; --inertia and --damping are then those "
              "of the motor's side [kg·m²].")  # fmt: skip
@click.option("--transmission-stiffness", type=_POSITIVE, metavar="k",
              help="Stiffness of the transmission [N·m/rad].")  # fmt: skip
@click.option("--transmission-damping", type=Number(0), metavar="c",
              help="Damping of the transmission [N·m·s/rad]; default: 0.")  # fmt: skip
@click.option("--encoder", type=click.Choice(["output", "motor"]),
              help="Side of the transmission that the encoder is on; default: output.")  # fmt: skip
@plot_option("Draw the K-B plane as PNG to this path.")
@json_option
def command(
    config: str | None,
    sets: tuple[str, ...],
    axis: str | None,
    dampings: list[float] | None,
    plot: Path | None,
    **given: Any,  # noqa: ANN401 - the options that make the question
) -> None:
    """Compute the stiffness limits of a wall over its virtual damping.

    The servo is an inertia with viscous friction. Its torque is held over each period and acts a
    delay after its sample. CONFIG gives the loop and the belief about the servo, with its bounds,
    encoder, a load on a flexible transmission, and a filter of the velocity.

    \b
    haptic-wall boundary --servo MX-64 --period 0.001 --delay 0.002 --virtual-damping 0,0.1,0.5
    """  # noqa: D301 - the \b is what click takes for "as it stands"
    if config is None and (sets or axis):
        field = "--set" if sets else "--axis"
        raise UserError("there is no CONFIG", field=field, advice="give a preset or a file too")
    question = _of_options(given) if config is None else _of_config(config, sets, axis, given)
    try:
        chosen = default_dampings(question) if dampings is None else dampings
        with working("computing the limits"):
            found = report(question, chosen)
    except ValueError as error:  # numbers so extreme that only the theory can tell
        raise UserError(error, advice="check that all values are in SI units") from None
    if plot is not None:
        from haptic_wall.controller.report.boundary import plot_boundary

        drawn_or_noted("--plot", plot, partial(plot_boundary, question, found))
    answer(found, lambda: boundary_text(found))


def _of_config(
    name: str, sets: tuple[str, ...], axis: str | None, given: dict[str, Any]
) -> Question:
    """Return the question of a configuration: servo and loop as it believes them to be.

    Raises:
        UserError: The configuration is wrong, or an option asks for something else than it has.
    """
    for option, value in given.items():
        if value is not None and option not in ("delay", "side"):
            raise UserError(
                "CONFIG gives this value",
                field=f"--{option.replace('_', '-')}",
                advice="leave the option out, or change CONFIG with --set",
            )
    loaded = load_axis(name, sets, axis)
    refuse_unknown(loaded, of_walls=True, filters=True)
    config = loaded.config
    belief, period = config.belief(), config.period_ns * 1e-9
    before, lag = config.delay.steps * period + config.guard.sample_age, belief.delay
    delay = Bounded(before + lag.value, before + lag.low, before + lag.high)
    if given["delay"] is not None:
        delay = Bounded.exactly(given["delay"])
    filtered = config.velocity_filter()
    side: WallSide = given["side"] or ("both" if config.wall.side == "both" else "one")
    if filtered is not None and side == "one":
        raise UserError(
            "the limit of a one-sided wall with a velocity filter is not known",
            field="--side",
            wanted="both",
        )
    limit = config.servo.torque_limit
    counted = (limit, config.servo.position_step) if limit else (1.0, 0.0)
    return replace(
        _question(belief, period, delay, *counted),
        side=side,
        velocity_samples=config.wall.velocity_samples,
        velocity_filter=filtered,
    )


def _of_options(given: dict[str, Any]) -> Question:
    """Return the question of the options.

    Raises:
        UserError: An option is missing; the message names it.
    """
    facts = given["servo"] and SERVOS[given["servo"]]
    known = {name: given[name] for name in ("inertia", "damping", "period", "delay")}
    for name, value in known.items():
        if value is None and facts is not None and hasattr(facts, name):
            known[name] = getattr(facts, name)
        elif value is None:
            raise UserError("missing", field=f"--{name}", advice="give it, or a CONFIG")
    belief = Belief(
        inertia=Bounded.exactly(known["inertia"]),
        damping=Bounded.exactly(known["damping"]),
        coulomb=Bounded.exactly(facts.coulomb if facts else 0.0),
        delay=Bounded.exactly(known["delay"]),
        torque_gain=Bounded.exactly(1.0),
    )
    return replace(
        _question(belief, known["period"], belief.delay, 1.0, 0.0),
        side=given["side"] or "one",
        load=_load(given, known["damping"]),
    )


def _question(
    belief: Belief, period: float, delay: Bounded, torque_limit: float, position_step: float
) -> Question:
    if delay.high > _MOST_PERIODS * period:
        raise UserError(
            f"{delay.high / period:.4g} periods of {period:g} s",
            field="--delay",
            wanted=f"at most {_MOST_PERIODS}",
            advice="check the period",
        )
    situation = Situation(replace(belief, delay=delay), period, torque_limit, position_step)
    return Question(situation)


def _load(given: dict[str, Any], servo_damping: float) -> Load | None:
    """Return the load that the options describe; None: there is none.

    Raises:
        UserError: It is incomplete, or there is no damping.
    """
    names = ("load_inertia", "transmission_stiffness", "transmission_damping", "encoder")
    inertia, stiffness, damping, encoder = (given[name] for name in names)
    if all(given[name] is None for name in names):
        return None
    if inertia is None or stiffness is None:
        raise UserError(
            "missing",
            field="--load-inertia" if inertia is None else "--transmission-stiffness",
            advice="a load needs both --load-inertia and --transmission-stiffness",
        )
    if not servo_damping and not damping:
        raise UserError(
            "servo and load have no damping",
            field="--damping",
            advice="give --damping or --transmission-damping",
        )
    return Load(inertia, stiffness, damping or 0.0, encoder or "output")
