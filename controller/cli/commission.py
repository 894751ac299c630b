"""``haptic-wall commission``: measures from end to end how stiff a wall a servo can render."""

from __future__ import annotations

import json
import signal
import sys
from collections.abc import Mapping
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from haptic_wall.controller.cli.experiment import REACH, Asked, experiment, folder_option, moving
from haptic_wall.controller.cli.numbers import Number
from haptic_wall.controller.cli.options import answer, as_json, say, writing
from haptic_wall.controller.cli.places import take_folder
from haptic_wall.controller.cli.working import DRAWING_S, working
from haptic_wall.controller.errors import UserError
from haptic_wall.controller.system.files import whole
from haptic_wall.controller.system.signals import on_signals
from haptic_wall.controller.system.wrapping import wrapped

if TYPE_CHECKING:
    from haptic_wall.controller.experiments.commission.plan import Announcement
    from haptic_wall.controller.experiments.commission.sequence import Ended
    from haptic_wall.controller.experiments.commission.steps import Plot, Step


@click.command()
@click.option(
    "--reach",
    type=Number(),
    default=REACH,
    show_default=True,
    metavar="RAD",
    help="Largest excursion of the shaft to either side of its position, for identify.",
)
@experiment(
    folder_option(
        "Folder for report.txt, config.yaml, commission.json, pictures and logs/.", needed=True
    ),
    of_walls=True,
)
def command(asked: Asked, reach: float) -> None:
    """Examine, identify and measure CONFIG's servo; report its stiffest wall and the reasons.

    It runs doctor, identify and a short sweep, and writes DIR/config.yaml for haptic-wall
    run, and DIR/report.txt for you. The shaft moves by itself and must be free.

    Exit status: that of the first step that failed.
    """
    from haptic_wall.controller.experiments.commission.plan import announce

    config, out = asked.config, asked.out
    assert out is not None
    announcement = announce(config, reach)
    from haptic_wall.controller.experiments.commission.sequence import FILES, run_steps
    from haptic_wall.controller.experiments.commission.steps import CONFIG, StepContext

    if asked.file is not None and asked.file.resolve() == (out / CONFIG).resolve():
        raise UserError(f"it would replace its own CONFIG {asked.file}", field="--out")
    take_folder("--out", out, FILES)
    bench = StepContext(config, asked.name, reach, out, say, step_plots())
    announced(asked, announcement)
    with writing("--out", out):
        with moving(config, announcement.seconds):
            ended = run_steps(bench)
        with (
            on_signals(signal.SIG_IGN),  # a held Ctrl-C must not cost the report
            working("writing the report", DRAWING_S),
        ):
            report = written(ended, asked.name, out)
    answer(report, lambda: _text(report, out))
    if ended.interrupted:
        say(f"interrupted: finished steps are in {out}")
    sys.exit(ended.exit_status)


def step_plots() -> dict[Step, Plot]:
    """Return the function that draws each step's picture."""
    from haptic_wall.controller.report.identify import plot_identification
    from haptic_wall.controller.report.sweep import plot_sweep

    return {"identify": plot_identification, "sweep": plot_sweep}


def announced(asked: Asked, announcement: Announcement) -> None:
    """Announce the motions; before a real servo moves, wait for a yes."""
    minutes, config = announcement.seconds / 60.0, asked.config
    time = f"about {minutes:.0f} min"
    if config.loop.clock == "simulated":
        time += " of simulated time, which pass in a fraction of that"
    elif config.servo.kind == "simulated":
        time += "; --set loop.clock=simulated does the same in a fraction of that"
    say(f"{asked.name}: {time}")
    for line in announcement.lines:
        say("\n".join(_wrapped(line, "  ")))
    servo = config.servo
    if servo.kind == "hardware" and not asked.yes and not sys.stdin.isatty():
        raise UserError(
            f"the servo at {servo.port} is real, and standard input is no terminal for a question",
            advice="give --yes when the shaft's way is free",
        )
    asked.may_move()


def written(ended: Ended, name: str, folder: Path) -> dict[str, Any]:
    """Write the report of a commissioning, as text and data; return its data.

    Raises:
        OSError: They cannot be written.
    """
    from haptic_wall.controller.experiments.commission.sequence import JSON, TEXT, report

    data: dict[str, Any] = json.loads(as_json(report(ended, name, folder)))
    data["report"] = str(folder / TEXT)
    write_all(folder, {TEXT: _text(data, folder) + "\n", JSON: as_json(data) + "\n"})
    return data


def write_all(folder: Path, texts: Mapping[str, str]) -> None:
    """Write texts to the files of their names: all, or none.

    Raises:
        OSError: One cannot be written.
    """
    with ExitStack() as all_or_none:
        for name, text in texts.items():
            part = all_or_none.enter_context(whole(folder / name))
            part.write_text(text, encoding="utf-8")


def _text(report: dict[str, Any], folder: Path) -> str:
    from haptic_wall.controller.report import commission_text as words

    lines = [*_wrapped(words.headline(report), "")]
    parts = {
        "Why": words.why(report),
        "Theory and measurement": words.agrees(report),
        "Not known": words.unknown(report),
    }
    for title, sentences in parts.items():
        told = [line for sentence in sentences for line in _wrapped(sentence, "  ")]
        lines += ["", title, *told] if told else []
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
    drawn = any(step["picture"] for step in report["steps"])
    moved = ["pictures"] * drawn + ["logs/"] * (folder / "logs").exists()
    made = [] if report["config"] is None else ["config.yaml"]
    files = ", ".join(["report.txt", "commission.json", *moved, *made])
    return "\n".join([*lines, "", f"written to {folder}: {files}"])


def _wrapped(text: str, indent: str) -> list[str]:
    return wrapped(text, indent, f"{indent}  " if indent else "")
