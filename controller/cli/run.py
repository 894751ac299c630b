"""``haptic-wall run``: renders the wall, then prints a report and draws the picture."""

from __future__ import annotations

import math
import os
import signal
import sys
from contextlib import AbstractContextManager
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import click

from haptic_wall import __version__
from haptic_wall.controller.cli.drawing import drawn
from haptic_wall.controller.cli.options import (
    answer,
    config_argument,
    json_option,
    say,
    set_option,
    wants_json,
    writing,
)
from haptic_wall.controller.cli.places import (
    force_option,
    is_forced,
    new_stem,
    refuse_other_pictures,
    take_file,
)
from haptic_wall.controller.cli.working import is_shown, working
from haptic_wall.controller.errors import UserError
from haptic_wall.controller.logs.file import SUFFIX, in_the_way, is_held
from haptic_wall.controller.report.run_text import report_text
from haptic_wall.controller.runtime.telemetry import Telemetry, Word
from haptic_wall.controller.settings.config import Config
from haptic_wall.controller.settings.load import load_config
from haptic_wall.controller.system.signals import STOPPING, interrupting, on_signals

if TYPE_CHECKING:
    from haptic_wall.controller.live.place import Live

SIMULATED_S = 5.0
"""Default duration [s]; hardware runs until Ctrl-C."""


@click.command()
@config_argument(default="simulated")
@set_option
@click.option("--duration", metavar="S",
              help="Time for which the wall is on [s]; inf: until Ctrl-C.")  # fmt: skip
@click.option("--log", "log_path", type=click.Path(path_type=Path),
              help="Write the log to this path; default: in ./runs/.")  # fmt: skip
@click.option("--plot", "plot_path", type=click.Path(path_type=Path),
              help="Draw the run as PNG to this path; default: beside the log.")  # fmt: skip
@click.option("--no-plot", is_flag=True, help="Draw no picture.")
@click.option("--witness", type=click.Path(path_type=Path),
              help="Record every frame of the emulated bus and the true motion to this CSV "
              "file.")  # fmt: skip
@click.option("--live", metavar="[HOST:PORT]", is_flag=False, flag_value="localhost:0",
              help="Show the run in a browser; prints the address. Default: a free port, for this "
              "machine.")  # fmt: skip
@click.option("--live-control", is_flag=True,
              help="With --live: whoever has the page's address may change the wall.")  # fmt: skip
@click.option("--hold", metavar="SOURCE", multiple=True,
              help="Dead man: the wall is on only while SOURCE is held: /dev/input/eventN, "
              "any key or pedal of it; or page, a button on the page of "
              "--live-control.")  # fmt: skip
@click.option("-v", "--verbose", is_flag=True,
              help="Print the whole report instead of about eight lines.")  # fmt: skip
@force_option
@json_option
def command(
    config: str,
    sets: tuple[str, ...],
    duration: str | None,
    log_path: Path | None,
    plot_path: Path | None,
    no_plot: bool,
    witness: Path | None,
    live: str | None,
    live_control: bool,
    hold: tuple[str, ...],
    verbose: bool,
) -> None:
    """Run the wall of CONFIG: a preset's name or a YAML file (default: simulated).

    On hardware it runs until Ctrl-C, simulated and emulated for 5 s. --duration sets another time;
    --duration inf: until Ctrl-C. At the end of every run the torque is off. At a terminal one line
    shows the state of the run; space or q ends it.
    """
    from haptic_wall.controller.cli.live_line import live_line
    from haptic_wall.controller.processes import run_report as reports
    from haptic_wall.controller.processes.plan import Plan
    from haptic_wall.controller.processes.run import Shown, run

    loaded = load_config(config, sets, runs=True)
    effective = loaded.config
    seconds = _duration(effective, duration)
    memory = effective.loop.clock == "simulated"
    if witness is not None and (effective.servo.kind != "emulated" or memory):
        raise UserError(
            "only an emulated bus in its own process keeps a record",
            field="--witness",
            advice="run emulated-xm430 on the monotonic clock, or leave the option out",
        )
    if memory and (live or hold):
        raise UserError(
            "on the simulated clock a run is over before it can be watched",
            field="--live" if live else "--hold",
            advice="leave it out, or run with --set loop.clock=monotonic",
        )
    shown_live = _live(live, control=live_control)
    held = _hold(hold, page=shown_live is not None and bool(shown_live.token))
    if no_plot and plot_path is not None:
        raise UserError(
            "found both --plot and --no-plot", field="--no-plot", advice="leave one of them out"
        )
    log, plot = _places(log_path, plot_path, witness, loaded.name, draws=not no_plot)
    plan = Plan(
        config=effective,
        duration_s=seconds,
        log=log,
        metadata={
            "program": f"haptic-wall {__version__}",
            "name": loaded.name,
            "config": effective.model_dump(mode="json"),
        },
        witness=witness,
        live=shown_live,
        hold=held,
        changeable=True,
        force=is_forced(),
    )
    say(f"{loaded.name}: {'until Ctrl-C' if seconds is None else f'{seconds:g} s'}")
    if shown_live is not None:
        say(f"live: {shown_live.address}")
    rows = (seconds or math.inf) * effective.loop.rate_hz

    def progress(telemetry: Telemetry) -> AbstractContextManager[object]:
        return working("running", share=lambda: telemetry.words[Word.HEAD] / rows)

    shown: Shown = progress
    if not wants_json() and is_shown(sys.stderr) and not memory:
        shown = partial(live_line, axes=plan.axes)
    ended = run(plan, say, shown)
    with on_signals(signal.SIG_IGN):  # a held Ctrl-C must not cost the report
        warning = "" if plot is None else "no picture: there is no log"
        if ended.logged and plot is not None:
            warning = _draw(log, plot, ended.stop_reason)
        if warning:
            ended.warnings.append(warning)
        report = reports.run_report(
            effective,
            ended,
            str(log) if ended.logged else None,
            None if warning or plot is None else str(plot),
        )
        answer(report, lambda: report_text(report, brief=not verbose))
    no_wall = report["waited_for"] or report["no_stiffness"]
    sys.exit(reports.exit_status(ended.stop_reason, no_wall, ended.log))


def _live(place: str | None, *, control: bool) -> Live | None:
    """Return the live page's place; it listens already."""
    if place is None:
        if control:
            raise UserError(
                "found without --live", field="--live-control", advice="add --live, or leave it out"
            )
        return None
    from haptic_wall.controller.live.place import live_at

    return live_at(place, control=control)


def _hold(sources: tuple[str, ...], *, page: bool) -> str | None:
    """Return the dead man's source; None if there is none.

    Args:
        sources: As given.
        page: Whether there is a page that may change the wall.

    Raises:
        UserError: There is more than one, or it cannot serve as a dead man.
    """
    if not sources:
        return None
    source, *others = sources
    if others:
        raise UserError("found two sources", field="--hold", wanted="one: a run has one dead man")
    from haptic_wall.controller.processes.hold import PAGE, opened

    if source != PAGE:
        os.close(opened(source))
    elif not page:
        raise UserError(
            f"a {PAGE} can hold the dead man only if it may change the wall",
            field="--hold",
            advice="add --live --live-control",
        )
    return source


def _duration(config: Config, asked: str | None) -> float | None:
    if asked is None:
        return None if config.servo.kind == "hardware" else SIMULATED_S
    try:
        seconds = float(asked)
    except ValueError:
        seconds = math.nan
    if not seconds > 0.0:
        wanted = "seconds above 0, such as 2.5, or inf"
        raise UserError(f"found {asked}", field="--duration", wanted=wanted)
    return None if seconds == math.inf else seconds


def _places(
    log: Path | None,
    plot: Path | None,
    witness: Path | None,
    name: str,
    *,
    draws: bool,
) -> tuple[Path, Path | None]:
    """Return the paths of log and picture; by default in ./runs/, the picture beside the log."""
    if draws and plot is None and log is not None:
        with writing("--log", log):
            if log.is_file() or not log.exists():
                plot = log.with_suffix(".png") if log.suffix == SUFFIX else Path(f"{log}.png")
    if plot is not None:
        refuse_other_pictures("--plot", plot)
    for option, path in (("--log", log), ("--plot", plot), ("--witness", witness)):
        if path is not None:
            with writing(option, path):
                if path.is_fifo():  # opening it would wait for a reader, and Ctrl-C would not help
                    raise UserError(f"{path} is a pipe", field=option, advice="name a file")
            # An unwritable place is reported, and the run goes on without it.
            take_file(option, path, try_it=False)
            if option == "--log":
                _refuse_no_log(path)
    if log is not None and (plot is not None or not draws):
        return log, plot
    stem = new_stem("--log" if log is None else "--plot", Path(name).stem, SUFFIX)
    return (
        stem.with_name(f"{stem.name}.hwlog") if log is None else log,
        stem.with_name(f"{stem.name}.png") if plot is None and draws else plot,
    )


def _refuse_no_log(path: Path) -> None:
    """Refuse a place where a database cannot be, or would replace files beside it.

    Raises:
        UserError: It is such a place.
    """
    if path.exists() and not path.is_file():
        raise UserError(f"{path} is a device", field="--log", advice="name a file")
    if not path.exists() and not os.access(path.parent, os.W_OK | os.X_OK):
        say(f"--log {path}: its folder cannot be written: unless that changes, there is no log")
    held = path.is_file() and is_held(path)
    if held or (other := in_the_way(path)) is not None:
        what = f"another program has {path} open" if held else f"{other} is in the way"
        raise UserError(what, field="--log", advice="name another place")


def _draw(log: Path, plot: Path, stop_reason: str) -> str:
    """Draw the picture from the log; return the error, or an empty text."""
    try:
        # The drawing can be interrupted.
        with interrupting(STOPPING):
            from haptic_wall.controller.logs.reader import LogReader
            from haptic_wall.controller.report.run import plot_log

            draw = partial(plot_log, LogReader.open(log), stop_reason=stop_reason)
            drawn("--plot", plot, draw)
    except (OSError, UserError) as error:
        return f"no picture: {error}"
    except KeyboardInterrupt:
        return f"no picture: interrupted; `haptic-wall log {log} --plot {plot}` draws it"
    return ""
