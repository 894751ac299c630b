"""What the commands that experiment share: leave to move, where files go, how one may end."""

from __future__ import annotations

import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import click

from controller.cli.interrupt import INTERRUPTED
from controller.cli.options import refuse_no_folder, say
from controller.experiments.testbed import ExperimentInterruptedError, ExperimentTrippedError
from controller.report import exit_status
from controller.settings.servo import Servo

yes_option = click.option("--yes", is_flag=True, help="Do not ask before a real servo moves.")


def ask_to_move(servo: Servo, yes: bool) -> None:
    """Before a real servo moves by itself, wait for somebody's leave, where somebody is.

    Args:
        servo: Of the configuration.
        yes: It is given already.

    Raises:
        click.Abort: It is not given.
    """
    if servo.kind != "hardware" or yes or not sys.stdin.isatty():
        return
    say("keep its way free and the power switch at hand; Ctrl-C ends it at any time, torque off")
    click.confirm(f"May servo {servo.id} at {servo.port} move?", abort=True, err=True)


def folder_for(out: Path | None, what: str) -> Path:
    """The folder of an experiment's files: the one named, or a new one in ./runs/.

    Args:
        out: What ``--out`` names; None: nothing.
        what: The command.

    Raises:
        UserError: It is a file, or cannot be looked at.
    """
    if out is not None:
        refuse_no_folder("--out", out)
        return out
    folder = Path("runs") / f"{time.strftime('%Y%m%d-%H%M%S')}-{what}"
    while folder.exists():  # two within a second
        folder = folder.with_name(folder.name + "+")
    return folder


@contextmanager
def endings() -> Iterator[None]:
    """Give an experiment that a person or a trip has ended its exit status."""
    try:
        yield
    except ExperimentInterruptedError as error:
        say(f"haptic-wall: {error}")
        sys.exit(INTERRUPTED)
    except ExperimentTrippedError as error:
        say(f"haptic-wall: {error.stop_reason}: {error}")
        sys.exit(exit_status(error.stop_reason))
