"""Shared parts of the experiments' commands: consent to move, files, exit status."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator, Mapping
from contextlib import AbstractContextManager, contextmanager
from pathlib import Path
from typing import Any

import click

from haptic_wall.controller.cli.failure import EndedEarlyError
from haptic_wall.controller.cli.interrupt import INTERRUPTED
from haptic_wall.controller.cli.options import as_json, say, writing
from haptic_wall.controller.cli.places import new_stem, take_folder
from haptic_wall.controller.cli.working import DRAWING_S, Work, working
from haptic_wall.controller.experiments.testbed import (
    ExperimentInterruptedError,
    ExperimentTrippedError,
)
from haptic_wall.controller.processes.run_report import exit_status
from haptic_wall.controller.settings.config import Config
from haptic_wall.controller.settings.servo import Servo
from haptic_wall.controller.system.file_kinds import PICTURE, RESULT
from haptic_wall.controller.system.whole_file import whole

_FASTER = 20.0
"""Speed of the simulated clock relative to real time"""
yes_option = click.option("--yes", is_flag=True, help="Do not ask before a real servo moves.")


def ask_to_move(servo: Servo, yes: bool) -> None:
    """Wait for a person's consent before a real servo moves by itself.

    Args:
        servo: Of the configuration.
        yes: Consent is already given.

    Raises:
        click.Abort: Consent is refused.
    """
    if servo.kind != "hardware" or yes or not sys.stdin.isatty():
        return
    say("keep its way free and the power switch at hand; Ctrl-C ends it at any time, torque off")
    click.confirm(f"May servo {servo.id} at {servo.port} move?", abort=True, err=True)


def moving(config: Config, seconds: float) -> AbstractContextManager[Work]:
    """Show that a servo is being moved.

    Args:
        config: Of the servo.
        seconds: Approximate duration in real time [s].
    """
    simulated = config.loop.clock == "simulated"
    return working("measuring", seconds / _FASTER if simulated else seconds)


def folder_for(out: Path | None, what: str, *, force: bool) -> Path:
    """Return the folder of an experiment's files: the named one, or a new one in ./runs/.

    Args:
        out: Value of ``--out``; None: not given.
        what: The command, also the name of JSON and picture.
        force: Replace any file of these names.

    Raises:
        UserError: It is a file, or cannot be accessed, or its files are not of this program.
    """
    if out is None:
        return new_stem("--out", what)
    take_folder("--out", out, {f"{what}.json": RESULT, f"{what}.png": PICTURE}, force=force)
    return out


def keep(
    folder: Path,
    what: str,
    report: Mapping[str, Any],
    draw: Callable[[Path], None],
    *,
    force: bool,
) -> None:
    """Write an experiment's JSON and picture.

    Args:
        folder: From ``folder_for``.
        what: As for ``folder_for``.
        report: Content of the JSON, ``RESULT_MARK`` first.
        draw: Draws the picture.
        force: As for ``folder_for``.

    Raises:
        UserError: They cannot be written.
    """
    json_whole = whole(folder / f"{what}.json", RESULT, force=force)
    picture_whole = whole(folder / f"{what}.png", PICTURE, force=force)
    drawing = working("drawing the picture", DRAWING_S)
    with drawing, writing("--out", folder), json_whole as json_part, picture_whole as picture_part:
        json_part.write_text(as_json(report) + "\n", encoding="utf-8")
        draw(picture_part)


@contextmanager
def endings() -> Iterator[None]:
    """Give an experiment that a person or a trip has ended its exit status."""
    try:
        yield
    except ExperimentInterruptedError as error:
        raise EndedEarlyError(str(error), INTERRUPTED) from None
    except ExperimentTrippedError as error:
        status = exit_status(error.stop_reason)
        raise EndedEarlyError(f"{error.stop_reason}: {error}", status) from None
