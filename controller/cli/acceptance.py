"""``haptic-wall acceptance``: predicts and measures a real servo, and packs all into one file."""

from __future__ import annotations

import hashlib
import json
import os
import sys
from collections.abc import Iterator
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from haptic_wall import __version__
from haptic_wall.controller.cli.drawing import drawn_or_noted
from haptic_wall.controller.cli.experiment import REACH, Asked, experiment, folder_option, moving
from haptic_wall.controller.cli.failure import EndedEarlyError
from haptic_wall.controller.cli.interrupt import INTERRUPTED
from haptic_wall.controller.cli.options import as_json, say, writing
from haptic_wall.controller.cli.places import take_folder
from haptic_wall.controller.cli.working import DRAWING_S, working
from haptic_wall.controller.cli.wrapping import wrapped
from haptic_wall.controller.errors import UserError
from haptic_wall.controller.system.files import whole
from haptic_wall.controller.system.json_text import RESULT_MARK
from haptic_wall.hw.errors import Problem

if TYPE_CHECKING:
    from haptic_wall.controller.experiments.acceptance.predictions import Weight
    from haptic_wall.controller.experiments.acceptance.sequence import Measured

_JSON, _PNG, _PAGE = "acceptance.json", "acceptance.png", "report.html"
_LEVER = 0.05
"""Lever of the weight of a simulated or emulated servo [m]"""
_HELD = 0.5
"""Torque of that weight over the least believed friction: nobody holds it until the servo does"""
_EMULATED_S = 60.0
"""Duration of the steps on the emulated servo, about [s]"""


@click.command()
@click.option(
    "--weight",
    type=float,
    metavar="KG",
    help="Mass of a known weight for the load step. Without it a real servo skips that step.",
)
@click.option(
    "--lever",
    type=float,
    metavar="M",
    help="Distance of the weight's centre from the shaft's axis.",
)
@click.option("--plan", "only_plan", is_flag=True, help="Only announce the steps.")
@click.option("--fresh", is_flag=True, help="Measure again. The predictions stay.")
@experiment(
    folder_option(
        "Folder for predictions.json, report.html, acceptance.zip and the measurements. The command"
        " continues an interrupted acceptance in DIR."
    ),
    force=False,
    of_walls=True,
)
def command(
    asked: Asked, weight: float | None, lever: float | None, only_plan: bool, fresh: bool
) -> None:
    """Guide you through the acceptance of a real servo, in about fifteen minutes.

    Each step names its motion, your part, its measurement and the assumption that it settles. The
    command writes predictions with bounds before the shaft moves. Then it repeats the steps with an
    emulated servo. DIR/acceptance.zip has all results, without personal data, to be sent back.

    Exit status: that of the first step that failed.
    """
    from haptic_wall.controller.experiments.commission.plan import announce

    hung = _weight(asked, weight, lever)
    seconds = announce(asked.config, REACH).seconds
    if only_plan:
        plan = {"name": asked.name, "seconds": seconds, "steps": _cards()}
        asked.answer(plan, lambda: "\n".join(_plan_lines(asked, seconds)))
        return
    if asked.out is None:
        raise UserError(
            "found nothing",
            field="--out",
            wanted="the folder for predictions, measurements and the bundle",
            advice="give for example --out acceptance",
        )
    take_folder("--out", asked.out, (), force=False)
    _refuse_foreign(asked.out)
    sys.exit(_accepted(asked, asked.out, hung, seconds, fresh))


def _refuse_foreign(out: Path) -> None:
    """Raise if there are files that an acceptance would replace, and no acceptance wrote."""
    from haptic_wall.controller.experiments.acceptance import bundle, predictions

    if (out / predictions.FILE).exists():
        return
    for name in (_JSON, _PNG, _PAGE, bundle.FILE, "measured", "emulated"):
        if os.path.lexists(out / name):
            raise UserError(
                f"found {name} without {predictions.FILE}: no acceptance began in this folder",
                field="--out",
                given=out,
                wanted="a new folder, or that of an earlier acceptance",
                advice="name another place",
            )


def _accepted(asked: Asked, out: Path, hung: Weight | None, seconds: float, fresh: bool) -> int:
    """Predict, measure, and write the report and the bundle; return the exit status."""
    from haptic_wall.controller.experiments.acceptance import predictions
    from haptic_wall.controller.experiments.acceptance.sequence import Bench, measured
    from haptic_wall.controller.experiments.acceptance.twin import twin_of
    from haptic_wall.controller.report.commission.picture import PLOTS

    config = asked.config
    _refuse_nobody(asked)
    with writing("--out", out):
        predicted = predictions.keep(out, config, hung)
    say(f"the predictions are written: {out / predictions.FILE}")
    for line in _plan_lines(asked, seconds):
        say(line)
    asked.may_move()
    common: dict[str, Any] = {
        "predicted_for": config,
        "name": asked.name,
        "weight": hung,
        "reach": REACH,
        "encode": as_json,
        "fresh": fresh,
    }
    person = _Person(asks=config.servo.kind == "hardware" and not asked.yes)
    with writing("--out", out):
        with moving(config, seconds):
            real = measured(
                Bench(
                    config=config,
                    folder=out / "measured",
                    tell=say,
                    before=person.before,
                    ready=person.ready,
                    plots=PLOTS,
                    **common,
                )
            )
        refused = real.outcomes.get("doctor")
        if refused is not None and refused.ends_all:
            raise EndedEarlyError(
                Problem(
                    f"nothing has moved: {refused.reason}",
                    advice=f"then the same command with --out {out} continues",
                ),
                real.exit_status,
            )
        if not real.interrupted:
            say("the same steps run on an emulated servo; nothing moves")
            with working("emulating", _EMULATED_S):
                twin = measured(
                    Bench(config=twin_of(config), folder=out / "emulated", tell=_quiet, **common)
                )
        if real.interrupted or twin.interrupted:
            advice = f"the same command with --out {out} continues"
            kept = Problem("interrupted: finished steps are kept", advice=advice)
            raise EndedEarlyError(kept, INTERRUPTED)
        with working("writing the report", DRAWING_S):
            report = _written(asked, out, predicted, real, twin)
    asked.answer(report, lambda: _text(report))
    return real.exit_status


def _written(
    asked: Asked, out: Path, predicted: dict[str, Any], real: Measured, twin: Measured
) -> dict[str, Any]:
    """Write report, picture and bundle; return the report's data."""
    from haptic_wall.controller.experiments.acceptance import bundle, predictions
    from haptic_wall.controller.experiments.acceptance.cards import CARDS, OPEN
    from haptic_wall.controller.experiments.acceptance.judged import FAILS, HOLDS, rows
    from haptic_wall.controller.experiments.kept_folder import replaced
    from haptic_wall.controller.report.acceptance.page import page
    from haptic_wall.controller.report.acceptance.picture import plot_acceptance

    found = [row.report() for row in rows(predicted, real, twin)]
    verdicts = [row["verdict"] for row in found]
    scrubber = bundle.Scrubber([out])
    config = asked.config
    name = Path(asked.name).name
    report = {
        **RESULT_MARK,
        "program": f"haptic-wall {__version__}",
        "name": name,
        "headline": f"{verdicts.count(HOLDS)} of {verdicts.count(HOLDS) + verdicts.count(FAILS)}"
        " predictions hold",
        "servo": config.servo.kind,
        "model": config.servo.model,
        "clock": config.loop.clock,
        "rate_hz": config.loop.rate_hz,
        "predictions_sha256": hashlib.sha256((out / predictions.FILE).read_bytes()).hexdigest(),
        "rows": found,
        "steps": [
            {
                **step,
                "moves": CARDS[step["step"]].moves,
                "measures": CARDS[step["step"]].measures,
                "settles": CARDS[step["step"]].settles,
            }
            for step in real.steps()
        ],
        "emulated_steps": twin.steps(),
        "bus": real.logged["bus"],
        "open": list(OPEN),
        "versions": bundle.versions(),
    }
    clean: dict[str, Any] = scrubber.values(json.loads(as_json(report)))
    draw = partial(plot_acceptance, clean["rows"], clean["name"])
    drawn = drawn_or_noted("--out", out / _PNG, draw)
    picture = None if drawn is None else drawn.read_bytes()
    text = page(clean, picture)
    with replaced(out / _PAGE) as stream:
        stream.write(text)
    with whole(out / _JSON) as part:
        part.write_text(as_json(clean) + "\n", encoding="utf-8")
    packed = out / bundle.FILE
    own: dict[str, str | bytes] = {
        _JSON: as_json(clean) + "\n",
        _PAGE: text.encode(),
        **({} if picture is None else {_PNG: picture}),
        predictions.FILE: (out / predictions.FILE).read_text(encoding="utf-8"),
    }
    folders = {"measured": out / "measured", "emulated": out / "emulated"}
    with whole(packed) as part:
        bundle.pack(part, folders, own, scrubber)
    return clean | {"bundle": str(packed), "report": str(out / _PAGE)}


class _Person:
    """Shows each step to the person at the bench, and waits where a real servo will move.

    Args:
        asks: Whether to wait.
    """

    def __init__(self, asks: bool) -> None:
        self._asks = asks

    def before(self, step: str) -> None:
        """Show a step; wait for a yes."""
        from haptic_wall.controller.experiments.acceptance.cards import CARDS

        for line in CARDS[step].lines():
            for part in wrapped(line.strip(), "    " if line.startswith(" ") else "", "      "):
                say(part)
        self._wait("Begin?")

    def ready(self, text: str) -> None:
        """Say what has to be done; wait for a yes."""
        say(f"    now: {text}")
        self._wait("Ready?")

    def _wait(self, question: str) -> None:
        if self._asks:
            click.confirm(question, default=True, abort=True, err=True)


def _quiet(_text: str) -> None:
    """Tell nothing: the emulated servo's steps are those that were told before."""


def _weight(asked: Asked, mass: float | None, lever: float | None) -> Weight | None:
    """Return the weight of the load step; None: there is none."""
    from haptic_wall.controller.experiments.acceptance.predictions import GRAVITY, Weight

    if (mass is None) != (lever is None):
        missing = "--lever" if lever is None else "--weight"
        raise UserError("missing", field=missing, advice="give both --weight and --lever")
    if mass is None or lever is None:
        held = _HELD * asked.config.belief().coulomb.low / (GRAVITY * _LEVER)
        real = asked.config.servo.kind == "hardware"
        return None if real or held == 0.0 else Weight(float(f"{held:.2g}"), _LEVER)
    for option, value, most, unit in (
        ("--weight", mass, 20.0, "kg"),
        ("--lever", lever, 1.0, "m"),
    ):
        if not 0.0 < value <= most:
            raise UserError(
                f"found {value:g}", field=option, wanted=f"more than 0 and up to {most:g} {unit}"
            )
    return Weight(mass, lever)


def _refuse_nobody(asked: Asked) -> None:
    servo = asked.config.servo
    if servo.kind == "hardware" and not asked.yes and not sys.stdin.isatty():
        raise UserError(
            f"the servo at {servo.port} is real, and standard input is no terminal for a question",
            advice="give --yes when the shaft's way is free",
        )


def _cards() -> list[dict[str, str]]:
    from haptic_wall.controller.experiments.acceptance.cards import CARDS

    return [
        {
            "step": name,
            "moves": card.moves,
            "hold": card.hold,
            "measures": card.measures,
            "settles": card.settles,
        }
        for name, card in CARDS.items()
    ]


def _plan_lines(asked: Asked, seconds: float) -> Iterator[str]:
    from haptic_wall.controller.experiments.acceptance.load import SECONDS
    from haptic_wall.controller.experiments.commission.plan import announce

    minutes = (seconds + SECONDS + _EMULATED_S) / 60.0
    simulated = asked.config.loop.clock == "simulated"
    yield f"{asked.name}: about {minutes:.0f} min" + (" of simulated time" if simulated else "")
    for line in announce(asked.config, REACH).lines:
        yield from wrapped(line, "  ", "    ")
    yield "  rest: nothing moves"
    yield "  load: the shaft travels 0.15 rad to each side, slowly, without and with a weight"


def _text(report: dict[str, Any]) -> str:
    from haptic_wall.controller.report.acceptance.page import figure_text, predicted_text

    lines = [f"{report['name']}: {report['headline']}", ""]
    for row in report["rows"]:
        unit = f" [{row['unit']}]" if row["unit"] else ""
        note = f": {row['note']}" if row["note"] else ""
        lines.append(f"{row['name']}{unit}: {row['verdict']}{note}")
        lines.append(
            f"    predicted {predicted_text(row)}; this servo {figure_text(row['real'])};"
            f" emulated {figure_text(row['emulated'])}"
        )
    lines.append("")
    for step in report["steps"]:
        if step["reason"]:
            lines += wrapped(f"{step['step']}: {step['state']}: {step['reason']}", "", "  ")
    return "\n".join(
        [*lines, f"report {report['report']}", f"look through {report['bundle']}, and send it back"]
    )
