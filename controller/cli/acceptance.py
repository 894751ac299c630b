"""``haptic-wall acceptance``: measures a real servo and its twin, and packs all into one file."""

from __future__ import annotations

import json
import sys
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from haptic_wall.controller.cli.commission import announced, step_plots, write_all, written
from haptic_wall.controller.cli.experiment import REACH, Asked, experiment, folder_option, moving
from haptic_wall.controller.cli.failure import EndedEarlyError
from haptic_wall.controller.cli.interrupt import INTERRUPTED
from haptic_wall.controller.cli.options import answer, as_json, say, writing
from haptic_wall.controller.cli.places import take_folder
from haptic_wall.controller.cli.working import DRAWING_S, working
from haptic_wall.controller.system.files import whole
from haptic_wall.controller.system.json_text import RESULT_MARK
from haptic_wall.controller.system.wrapping import wrapped
from haptic_wall.hw.errors import Problem

if TYPE_CHECKING:
    from haptic_wall.controller.experiments.commission.sequence import Ended

_JSON, _REPORT = "acceptance.json", "report.txt"
_MEASURED, _EMULATED = "measured", "emulated"
"""Folders of the two commissionings"""
_EMULATED_S = 60.0
"""Duration of the steps on the emulated servo, about [s]"""


@click.command()
@experiment(
    folder_option(
        "Folder for report.txt, acceptance.json, acceptance.zip and the measurements.",
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
    from haptic_wall.controller.experiments.commission.plan import announce, short_sweep
    from haptic_wall.controller.experiments.commission.sequence import FILES, run_steps
    from haptic_wall.controller.experiments.commission.steps import StepContext
    from haptic_wall.controller.experiments.holding import without_hand

    config, out = asked.config, asked.out
    assert out is not None
    announcement = announce(config, REACH)
    measured = [f"{folder}/{name}" for folder in (_MEASURED, _EMULATED) for name in FILES]
    take_folder("--out", out, (_JSON, _REPORT, bundle.FILE, *measured))
    announced(asked, announcement)

    bench = StepContext(config, asked.name, REACH, out / _MEASURED, say, step_plots())
    bench = replace(bench, points=short_sweep(without_hand(config)))  # of both servos
    with writing("--out", out):
        with moving(config, announcement.seconds):
            real = run_steps(bench)
        written(real, asked.name, bench.folder)
        doctor = real.outcomes.get("doctor")
        if doctor is not None and doctor.ends_all:
            raise EndedEarlyError(Problem(f"nothing has moved: {doctor.reason}"), real.exit_status)
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
            raise EndedEarlyError(Problem(f"interrupted: finished steps are in {out}"), INTERRUPTED)
        with working("writing the report", DRAWING_S):
            report = _packed(asked, out, real, twin)
    answer(report, lambda: f"{_text(report)}\nlook through {report['bundle']}, and send it back")
    sys.exit(real.exit_status)


def _packed(asked: Asked, out: Path, real: Ended, twin: Ended) -> dict[str, Any]:
    """Write report and bundle; return the report's data."""
    from haptic_wall.controller.experiments import acceptance, bundle

    config = asked.config
    found = acceptance.rows(config, real, twin)
    holds, fails = (
        sum(row["verdict"] == verdict for row in found)
        for verdict in (acceptance.HOLDS, acceptance.FAILS)
    )
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
    clean: dict[str, Any] = json.loads(bundle.scrubbed(as_json(report), out))
    own = {_JSON: as_json(clean) + "\n", _REPORT: _text(clean) + "\n"}
    write_all(out, own)
    folders = {name: out / name for name in (_MEASURED, _EMULATED)}
    with whole(out / bundle.FILE) as part:
        bundle.pack(part, out, folders, own)
    return clean | {"bundle": str(out / bundle.FILE), "report": str(out / _REPORT)}


def _text(report: dict[str, Any]) -> str:
    lines = [f"{report['name']}: {report['headline']}", ""]
    for row in report["rows"]:
        unit = f" [{row['unit']}]" if row["unit"] else ""
        note = f": {row['note']}" if row["note"] else ""
        lines.append(f"{row['name']}{unit}: {row['verdict']}{note}")
        lines.append(
            f"    predicted {_predicted_text(row)}; this servo {_figure_text(row['real'])};"
            f" emulated {_figure_text(row['emulated'])}"
        )
    lines.append("")
    for step in report["steps"]:
        if step["reason"]:
            lines += wrapped(f"{step['step']}: {step['state']}: {step['reason']}", "", "  ")
    versions = (f"{name} {version}" for name, version in report["versions"].items() if version)
    lines += wrapped(f"versions: {', '.join(versions)}", "", "  ")
    return "\n".join(lines)


def _predicted_text(row: Mapping[str, Any]) -> str:
    """Return the bounds of a prediction."""
    if row["low"] is None or row["high"] is None:
        return "-"
    low, high = (f"{row[end]:.5g}" for end in ("low", "high"))
    return low if low == high else f"{low} to {high}"


def _figure_text(found: Mapping[str, Any] | None) -> str:
    """Return a figure with its standard error and its kick."""
    if found is None:
        return "-"
    text = f"{found['value']:.5g}"
    if found["stderr"] is not None:
        text += f" ± {found['stderr']:.2g}"
    if found["kick_rad"] is not None:
        text += f" (kick {found['kick_rad']:.3g} rad)"
    return text
