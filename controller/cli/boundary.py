"""``haptic-wall boundary``: computes a servo's stiffness limits, and which changes raise them."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import Any

import click

from haptic_wall.controller.cli.boundary_question import LONGEST_PERIOD_S, of_config, of_options
from haptic_wall.controller.cli.boundary_text import boundary_text
from haptic_wall.controller.cli.drawing import drawn_or_noted
from haptic_wall.controller.cli.numbers import Number, Numbers, span
from haptic_wall.controller.cli.options import (
    FileToWrite,
    answer,
    as_json,
    config_argument,
    json_option,
    refuse_other_pictures,
    set_option,
)
from haptic_wall.controller.cli.places import force_option, take_file
from haptic_wall.controller.cli.working import working
from haptic_wall.controller.errors import UserError
from haptic_wall.controller.guard.boundary_curve import default_dampings
from haptic_wall.controller.guard.boundary_report import report


@click.command()
@config_argument(needed=False)
@set_option
@click.option(
    "--servo", "servo_name", metavar="NAME", help="A servo with published parameters, e.g. MX-64."
)
@click.option(
    "--inertia", callback=span, metavar="M", help="Inertia [kg·m²], a number or LOW:HIGH."
)
@click.option("--damping", callback=span, metavar="b", help="Viscous friction [N·m·s/rad].")
@click.option(
    "--period",
    type=Number(0, LONGEST_PERIOD_S, above=True, unit="s"),
    metavar="T",
    help="Sampling period [s].",
)
@click.option(
    "--rate",
    type=Number(1 / LONGEST_PERIOD_S, unit="Hz"),
    metavar="HZ",
    help="Sampling rate [Hz], instead of --period.",
)
@click.option(
    "--delay",
    callback=span,
    metavar="td",
    help="Total delay from a sample to its torque [s]. Default with CONFIG: the sum of inserted "
    "delay, guard.sample_age and model.delay.",
)
@click.option(
    "--torque-gain",
    callback=span,
    help="Acting torque over commanded torque; default: 1.",
)
@click.option(
    "--virtual-damping",
    "dampings",
    type=Numbers(Number()),
    metavar="B[,B...]",
    help="Virtual damping of each point [N·m·s/rad]; default: fractions of the ceiling.",
)
@click.option("--velocity-samples", type=Number(1, 64, whole=True), metavar="N",
              help="Samples over which the velocity is the difference; default: 1.")  # fmt: skip
@click.option("--velocity-filter", type=click.Choice(["none", "lowpass", "notch"]),
              help="Filter of the velocity that damps; wall two-sided. Default: none.")  # fmt: skip
@click.option("--velocity-hz", type=Number(), metavar="HZ",
              help="Corner of the low-pass, or middle of the notch.")  # fmt: skip
@click.option(
    "--velocity-q", type=Number(), metavar="Q", help="Quality of the filter; default: 0.7."
)
@click.option("--side", type=click.Choice(["one", "both"]),
              help="A one-sided wall never pulls. Default: CONFIG's, or one.")  # fmt: skip
@click.option("--load-inertia", type=Number(0, above=True), metavar="J",
              help="Inertia behind a flexible transmission; --inertia and --damping are then those "
              "of the motor's side [kg·m²].")  # fmt: skip
@click.option(
    "--transmission-stiffness",
    type=Number(0, above=True),
    metavar="k",
    help="Stiffness of the transmission [N·m/rad].",
)
@click.option("--transmission-damping", type=Number(0), metavar="c",
              help="Damping of the transmission [N·m·s/rad]; default: 0.")  # fmt: skip
@click.option("--encoder", type=click.Choice(["output", "motor"]),
              help="Side of the transmission that the encoder is on; default: output.")  # fmt: skip
@click.option(
    "--counts-per-rev", type=Number(0, above=True), metavar="N", help="Encoder counts in one turn."
)
@click.option(
    "--torque-limit", type=Number(0, above=True), metavar="NM", help="Torque limit [N·m]."
)
@click.option("--plot", type=FileToWrite(), help="Draw the K-B plane as PNG to this path.")
@force_option
@json_option
def command(
    config: str | None,
    sets: tuple[str, ...],
    dampings: tuple[float, ...] | None,
    plot: Path | None,
    force: bool,
    as_json_wanted: bool,
    **given: Any,  # noqa: ANN401 - the options that make the question
) -> None:
    """Compute the stiffness limits of a wall over its virtual damping, and remedies to raise them.

    The servo is an inertia with viscous friction. Its torque is held over each period and acts a
    delay after its sample. Inertia, damping, delay and torque gain may be ranges LOW:HIGH; limits
    then hold at the least safe corner. CONFIG gives the loop and the belief about the servo, with a
    load on a flexible transmission.

    \b
    haptic-wall boundary --servo MX-64 --rate 1000 --delay 0.002 --virtual-damping 0,0.1,0.5
    """  # noqa: D301 - the \b is what click takes for "as it stands"
    if plot is not None:
        refuse_other_pictures("--plot", plot)
        take_file("--plot", plot, force=force)
    question = of_options(given) if config is None else of_config(config, sets, given)
    if config is None and sets:
        raise UserError("there is no CONFIG", field="--set", advice="give a preset or a file too")
    try:
        chosen = default_dampings(question) if dampings is None else dampings
        with working("computing the limits"):
            found = report(question, chosen)
    except ValueError as error:  # numbers so extreme that only the theory can tell
        raise UserError(error, advice="check that all values are in SI units") from None
    if plot is not None:
        from haptic_wall.controller.report.boundary import plot_boundary

        drawn_or_noted("--plot", plot, partial(plot_boundary, question, found))
    answer(as_json(found) if as_json_wanted else boundary_text(found))
