"""``haptic-wall commission``: measures from end to end how stiff a wall a servo can render."""

from __future__ import annotations

import signal
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from haptic_wall.controller.cli.experiment import REACH, Asked, experiment, folder_option, moving
from haptic_wall.controller.cli.options import as_json, refuse_same_file, say, writing
from haptic_wall.controller.cli.places import take_folder
from haptic_wall.controller.cli.working import DRAWING_S, working
from haptic_wall.controller.cli.wrapping import wrapped
from haptic_wall.controller.errors import UserError
from haptic_wall.controller.settings.load import Loaded
from haptic_wall.controller.system.files import whole
from haptic_wall.controller.system.signals import on_signals

if TYPE_CHECKING:
    from haptic_wall.controller.experiments.commission.outcome import Step
    from haptic_wall.controller.experiments.commission.plan import Announcement
    from haptic_wall.controller.experiments.commission.sequence import Ended
    from haptic_wall.controller.experiments.commission.store import CommissionStore


@click.command()
@click.option("--fresh", is_flag=True, help="Replace an earlier commissioning in DIR.")
@click.option("--plan", "only_plan", is_flag=True, help="Only announce the motions and their size.")
@click.option(
    "--reach",
    type=float,
    default=REACH,
    show_default=True,
    metavar="RAD",
    help="Largest excursion of the shaft to either side of its position, for identify.",
)
@experiment(
    folder_option(
        "Folder for report.html, config.yaml, a JSON file of each step, pictures and logs/. The"
        " command continues an interrupted commissioning of the same settings in DIR."
    ),
    force=False,
    of_walls=True,
)
def command(asked: Asked, fresh: bool, only_plan: bool, reach: float) -> None:
    """Examine, identify and measure CONFIG's servo; report its stiffest wall and the reasons.

    It runs doctor, identify, delay, rendered and a short sweep, and writes DIR/config.yaml for
    haptic-wall run and DIR/report.html for you. The shaft moves by itself and must be free.

    Exit status: that of the first step that failed.
    """
    from haptic_wall.controller.experiments.commission.plan import announce

    loaded, out = asked.loaded, asked.out
    if only_plan:
        kept = [] if out is None else _store(asked, out, reach, fresh, True).done
        _answer_plan(announce(loaded.config, reach), kept, asked)
        return
    if out is None:
        raise UserError(
            "found nothing",
            field="--out",
            wanted="the folder for report.html and config.yaml",
            advice="give for example --out my-testbed",
        )
    announcement = announce(loaded.config, reach)
    was_there = out.exists()
    store = _store(asked, out, reach, fresh)
    folder = store.folder
    try:
        if not store.complete:
            _announce(asked, announcement)
        seconds = 0.0 if store.complete else announcement.seconds
        ended, report = _measured(loaded, reach, store, seconds)
    finally:
        empty = store.empty
        if empty:
            store.discard(keep_folder=was_there)
    asked.answer(report, lambda: _text(report, folder))
    if ended.interrupted and not empty:
        say(f"interrupted: finished steps are kept; the same command with --out {folder} continues")
    sys.exit(ended.exit_status)


def _measured(
    loaded: Loaded, reach: float, store: CommissionStore, seconds: float
) -> tuple[Ended, dict[str, Any]]:
    """Execute the steps, in about ``seconds`` [s]; write the report unless nothing was measured."""
    from haptic_wall.controller.experiments.commission.report import report
    from haptic_wall.controller.experiments.commission.sequence import run_steps
    from haptic_wall.controller.experiments.commission.steps import StepContext
    from haptic_wall.controller.report.commission.picture import PLOTS

    with writing("--out", store.folder):
        with moving(loaded.config, seconds):
            ended = run_steps(StepContext(loaded.config, loaded.name, reach, store, say, PLOTS))
        with (
            on_signals(signal.SIG_IGN),  # a held Ctrl-C must not cost the report
            working("writing the report", DRAWING_S),
        ):
            if store.empty:
                return ended, {**report(ended, loaded.name, store.folder), "report": None}
            return ended, _written(ended, loaded.name, store)


def _store(
    asked: Asked,
    out: Path,
    reach: float,
    fresh: bool,
    only_look: bool = False,
) -> CommissionStore:
    from haptic_wall.controller.experiments.commission.store import (
        CONFIG,
        CommissionStore,
        settings_of,
    )

    refuse_same_file({"CONFIG": asked.file, f"--out (its {CONFIG})": out / CONFIG})
    if not only_look:
        take_folder("--out", out, (), force=False)  # the store knows what may be replaced
    settings = settings_of(asked.config, reach)
    return CommissionStore(out, settings, asked.name, as_json, fresh, only_look)


def _answer_plan(announcement: Announcement, kept: list[Step], asked: Asked) -> None:
    """Print the plan of the steps; ``kept`` are steps that are not repeated."""
    plan = {"name": asked.name, "seconds": announcement.seconds, "steps": announcement.lines}
    lines = [*_plan_lines(asked.loaded, announcement)]
    if kept:
        lines += _wrapped(f"kept from before: {', '.join(kept)}", "  ")
    asked.answer({**plan, "kept": kept}, lambda: "\n".join(lines))


def _plan_lines(loaded: Loaded, announcement: Announcement) -> Iterator[str]:
    minutes = announcement.seconds / 60.0
    config = loaded.config
    if config.loop.clock == "simulated":
        time = f"about {minutes:.0f} min of simulated time, which pass in a fraction of that"
    else:
        time = f"about {minutes:.0f} min"
        if config.servo.kind == "simulated":
            time += "; --set loop.clock=simulated does the same in a fraction of that"
    yield f"{loaded.name}: {time}"
    for line in announcement.lines:
        yield from _wrapped(line, "  ")


def _announce(asked: Asked, announcement: Announcement) -> None:
    """Announce the motions; before a real servo moves, wait for a yes."""
    for line in _plan_lines(asked.loaded, announcement):
        say(line)
    servo = asked.config.servo
    if servo.kind == "hardware" and not asked.yes and not sys.stdin.isatty():
        raise UserError(
            f"the servo at {servo.port} is real, and standard input is no terminal for a question",
            advice="give --yes when the shaft's way is free",
        )
    asked.may_move()


def _written(ended: Ended, name: str, store: CommissionStore) -> dict[str, Any]:
    """Write the page; return the report's data."""
    from haptic_wall.controller.experiments.commission.report import report
    from haptic_wall.controller.experiments.commission.store import ALLOWED
    from haptic_wall.controller.experiments.commission.verdict import GuardQuestion
    from haptic_wall.controller.experiments.kept_folder import without_link
    from haptic_wall.controller.report.commission.page import page
    from haptic_wall.controller.report.commission.picture import draw_allowed

    folder = store.folder
    data = report(ended, name, folder)
    picture = folder / ALLOWED
    allowed: Path | None = picture
    try:
        with whole(without_link(picture)) as part:
            draw_allowed(GuardQuestion.of(ended.config, data["delay"]), data, part)
    except Exception as error:  # noqa: BLE001 - whatever may be wrong with what draws
        say(f"the picture of the verdict could not be drawn ({error}); the report lacks it")
        allowed = None
    data["report"] = str(store.keep_page(page(data, folder, allowed)))
    return data


def _text(report: dict[str, Any], folder: Path) -> str:
    from haptic_wall.controller.report.commission import words

    lines = [*_wrapped(words.headline(report), "")]
    parts = (
        ("Why", words.why(report)),
        ("Do theory and measurement agree?", words.agrees(report)),
        ("What is not known", words.unknown(report)),
    )
    for title, sentences in parts:
        lines += ["", title]
        for sentence in sentences:
            lines += _wrapped(sentence, "  ")
    lines += ["", "Steps"]
    for step in report["steps"]:
        reason = f": {step['reason']}" if step["reason"] else ""
        lines += _wrapped(f"{step['step']}: {step['state']}{reason}", "  ")
        if step["step"] == "doctor" and step["state"] == "done":
            for sentence in words.wrong(report):
                lines += _wrapped(sentence, "    ")
    following = list(words.following(report))
    if following:
        lines += ["", "What next", *(f"  {command}" for command, _ in following)]
    if report["report"] is None:
        return "\n".join([*lines, "", f"nothing was measured, so nothing is left in {folder}"])
    lines += ["", f"written to {folder}: report.html, commission.json, a JSON file of each step,"]
    lines += ["pictures, logs/" + ("" if report["config"] is None else ", config.yaml")]
    return "\n".join(lines)


def _wrapped(text: str, indent: str) -> list[str]:
    return wrapped(text, indent, f"{indent}  " if indent else "")
