"""``haptic-wall acceptance``: measures a real servo and its twin, and packs all into one file."""

from __future__ import annotations

import json
import sys
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from haptic_wall.controller.cli.commission import announced, write_all, written
from haptic_wall.controller.cli.experiment import REACH, Asked, experiment, folder_option, moving
from haptic_wall.controller.cli.failure import EndedEarlyError
from haptic_wall.controller.cli.interrupt import INTERRUPTED
from haptic_wall.controller.cli.options import answer, as_json, say, writing
from haptic_wall.controller.cli.places import is_forced, take_folder
from haptic_wall.controller.cli.working import DRAWING_S, working
from haptic_wall.controller.system.files import whole
from haptic_wall.controller.system.json_text import RESULT_MARK
from haptic_wall.controller.system.wrapping import wrapped
from haptic_wall.hw.errors import Problem

if TYPE_CHECKING:
    from haptic_wall.controller.experiments.commission.sequence import Ended

_JSON, _PAGE = "acceptance.json", "report.html"
_MEASURED, _EMULATED = "measured", "emulated"
"""Folders of the two commissionings"""
_EMULATED_S = 60.0
"""Duration of the steps on the emulated servo, about [s]"""


@click.command()
@experiment(
    folder_option(
        "Folder for report.html, acceptance.json, acceptance.zip and the measurements. The command"
        " continues an interrupted acceptance in DIR.",
        needed=True,
    ),
    of_walls=True,
)
def command(asked: Asked) -> None:
    """Commission CONFIG's servo and an emulated one beside it, and judge the belief by both.

    The command takes the steps of commission, and repeats them with an emulated servo that is what
    CONFIG believes. DIR/acceptance.zip has all results, without personal data, to be sent back.

    Exit status: that of the first step that failed.
    """
    from haptic_wall.controller.experiments import acceptance, bundle
    from haptic_wall.controller.experiments.commission.plan import announce
    from haptic_wall.controller.experiments.commission.sequence import ROWS, run_steps
    from haptic_wall.controller.experiments.commission.steps import StepContext
    from haptic_wall.controller.experiments.kept import refuse_foreign
    from haptic_wall.controller.report.commission.picture import PLOTS

    config, out = asked.config, asked.out
    assert out is not None
    announcement = announce(config, REACH)
    take_folder("--out", out, ())
    mark = f"{_MEASURED}/{ROWS}"
    refuse_foreign(out, mark, (_JSON, _PAGE, bundle.FILE, _MEASURED, _EMULATED))
    announced(asked, announcement)

    bench = StepContext(config, asked.name, REACH, out / _MEASURED, say, is_forced(), PLOTS)
    bench = replace(bench, points=acceptance.points(config))
    with writing("--out", out):
        with moving(config, announcement.seconds):
            real = run_steps(bench)
        written(real, asked.name, bench.folder)
        doctor = real.outcomes.get("doctor")
        if doctor is not None and doctor.ends_all:
            advice = f"then the same command with --out {out} continues"
            raise EndedEarlyError(
                Problem(f"nothing has moved: {doctor.reason}", advice=advice), real.exit_status
            )
        twin = real
        if not real.interrupted:
            say("the same steps run on an emulated servo; nothing moves")
            with working("emulating", _EMULATED_S):
                twin = run_steps(
                    replace(
                        bench,
                        config=acceptance.twin_of(config),
                        folder=out / _EMULATED,
                        tell=lambda _text: None,  # its steps are those that were told before
                        plots={},
                    )
                )
        if twin.interrupted:
            advice = f"the same command with --out {out} continues"
            kept = Problem("interrupted: finished steps are kept", advice=advice)
            raise EndedEarlyError(kept, INTERRUPTED)
        with working("writing the report", DRAWING_S):
            report = _packed(asked, out, real, twin)
    answer(report, lambda: _text(report))
    sys.exit(real.exit_status)


def _packed(asked: Asked, out: Path, real: Ended, twin: Ended) -> dict[str, Any]:
    """Write report and bundle; return the report's data."""
    from haptic_wall.controller.experiments import acceptance, bundle
    from haptic_wall.controller.report.acceptance.page import page

    config = asked.config
    found = acceptance.rows(config, real, twin)
    holds, fails = (
        sum(row["verdict"] == verdict for row in found)
        for verdict in (acceptance.HOLDS, acceptance.FAILS)
    )
    scrubber = bundle.Scrubber([out])
    report = {
        **RESULT_MARK,
        "name": Path(asked.name).name,
        "headline": f"{holds} of {holds + fails} predictions hold",
        "servo": config.servo.kind,
        "model": config.servo.model,
        "clock": config.loop.clock,
        "rate_hz": config.loop.rate_hz,
        "rows": found,
        "steps": real.steps(),
        "emulated_steps": twin.steps(),
        "versions": bundle.versions(),
    }
    clean: dict[str, Any] = scrubber.values(json.loads(as_json(report)))
    own = {_JSON: as_json(clean) + "\n", _PAGE: page(clean)}
    write_all(out, own)
    folders = {name: out / name for name in (_MEASURED, _EMULATED)}
    with whole(out / bundle.FILE) as part:
        bundle.pack(part, folders, own, scrubber)
    return clean | {"bundle": str(out / bundle.FILE), "report": str(out / _PAGE)}


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
