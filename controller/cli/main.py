"""The entry point ``haptic-wall``: runs a command, and maps errors to exit statuses.

A command's module is imported only when the command is called, so that help is quick.
"""

from __future__ import annotations

import errno
import gc
import importlib
import io
import logging
import os
import sys
from collections.abc import Sequence

import click

from haptic_wall import __version__
from haptic_wall.controller.cli import interrupt
from haptic_wall.controller.cli.failure import tell
from haptic_wall.controller.cli.options import begin, forget_output, say
from haptic_wall.controller.errors import (
    EXIT_STATUSES,
    HapticWallError,
    PlatformError,
    UserError,
)
from haptic_wall.hw.errors import ServoError
from haptic_wall.hw.names import did_you_mean

COMMANDS = {
    "run": "Run the wall; write report, log and picture at the end.",
    "set": "Change the wall that runs in another terminal.",
    "live": "Show a recorded run in a browser.",
    "demo": "Show in a browser why a stiff wall oscillates; no hardware.",
    "emulate": "Emulate a Dynamixel bus on a pseudo-terminal.",
    "scan": "List the servos on a bus: ids, baud rates, models.",
    "doctor": "Find the faults of a testbed, and the remedy of each.",
    "presets": "List the configurations that come with the program.",
    "config": "List all settings: value, unit, range, meaning.",
    "boundary": "Compute the stiffness limits of a servo and their causes.",
    "map": "Simulate many walls of a servo; map the critical stiffness.",
    "commission": "Run doctor, identify and sweep in one.",
    "acceptance": "Guide you through the acceptance of a first real servo.",
    "identify": "Measure inertia, friction and delay of a servo.",
    "sweep": "Measure the critical stiffness of a servo.",
    "zwidth": "Show which stiffness and damping a servo can render.",
    "delay": "Measure the loop's delay, from torque command to motion.",
    "detect": "Look for an oscillation in a log or a CSV.",
    "log": "Print the report in a log; export its rows, draw them.",
    "bench": "Measure timing and speed on this machine, beside peers.",
    "init": "Write a commented configuration, to be edited.",
    "paper": "Reproduce the table and figures of Gil et al. (ICRA 2007).",
}
"""The commands and their lines in the help; the module of the same name exports ``command``"""
NEEDS_LINUX = (
    *("run", "set", "demo", "emulate", "scan", "doctor", "commission", "acceptance"),
    *("sweep", "zwidth", "delay", "identify"),
)

HARDWARE = 4
USER = 2
_FULL = (errno.ENOSPC, errno.EFBIG, errno.EDQUOT)
_LIMITS = (*_FULL, errno.EMFILE, errno.ENFILE, errno.EAGAIN, errno.ENOMEM)
"""Errors by which the system says that a limit is reached"""
_COLLECTIONS = (50_000, 20, 50)
"""Allocations between two searches for garbage: Python's own 700 take an eighth of a start"""


class _Commands(click.Group):
    """Imports a command of ``COMMANDS`` when it is called."""

    def list_commands(self, ctx: click.Context) -> list[str]:  # noqa: ARG002 - click's signature
        return list(COMMANDS)

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command:  # noqa: ARG002
        if cmd_name not in COMMANDS:
            advice = "`haptic-wall --help` lists the commands"
            near = did_you_mean(cmd_name, COMMANDS)
            raise UserError(f"no command {cmd_name}", advice=near or advice)
        if cmd_name in NEEDS_LINUX and sys.platform != "linux":
            raise PlatformError(
                f"this machine runs {sys.platform}, but {cmd_name} needs Linux",
                advice="use a Linux machine or a virtual one",
            )
        command = importlib.import_module(f"{__package__}.{cmd_name}").command
        assert isinstance(command, click.Command)
        return command

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:  # noqa: ARG002
        with formatter.section("Commands"):
            formatter.write_dl(list(COMMANDS.items()))


@click.command(
    cls=_Commands,
    no_args_is_help=False,
    context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 100},
    epilog="Start with: haptic-wall run. Exit status: "
    + "; ".join(f"{status} {meaning}" for status, meaning in EXIT_STATUSES.items()),
)
@click.version_option(__version__, "-V", "--version", prog_name="haptic-wall")
def haptic_wall() -> None:
    """A virtual wall on a Dynamixel servo at a fixed rate, with a stability guard."""


def main(arguments: Sequence[str] | None = None) -> int:
    """Run a command; report an expected error as one message on standard error, not as a traceback.

    Args:
        arguments: Command-line arguments; None: those of this process.

    Returns:
        The exit status.
    """
    gc.set_threshold(*_COLLECTIONS)
    # pydantic would read the metadata of all that is installed: 15 ms in each process of a run.
    os.environ.setdefault("PYDANTIC_DISABLE_PLUGINS", "__all__")
    _fill_missing_streams()
    if isinstance(sys.stdout, io.TextIOWrapper):  # a terminal without µ gets a question mark
        sys.stdout.reconfigure(errors="replace")
    logging.basicConfig(level=logging.WARNING, handlers=[_Said()])
    begin("--json" in (sys.argv[1:] if arguments is None else arguments))
    try:
        result = haptic_wall.main(arguments, prog_name="haptic-wall", standalone_mode=False)
        sys.stdout.flush()
    except click.ClickException as error:
        return tell(error, USER)
    except (click.Abort, KeyboardInterrupt):
        return tell(KeyboardInterrupt(), interrupt.INTERRUPTED)
    except HapticWallError as error:
        return tell(error, error.exit_status)
    except ServoError as error:
        return tell(error, HARDWARE)
    except BrokenPipeError:
        forget_output()
        return 0  # the reader has seen enough (``| head``)
    except (OSError, MemoryError) as error:
        return _tell_of_system(error)
    return result if isinstance(result, int) else 0


def _tell_of_system(error: OSError | MemoryError) -> int:
    """Report an error of the operating system; return the exit status.

    Raises:
        OSError: The error is unexpected: a defect of the program.
    """
    number = error.errno if isinstance(error, OSError) else errno.ENOMEM
    if number in _LIMITS:
        if number in _FULL:
            forget_output()
        limit = PlatformError(
            f"the system refuses a resource: {os.strerror(number or 0)}",
            advice="make room, raise the limits of this shell (`ulimit -a`), or end other programs",
        )
        return tell(limit, limit.exit_status)
    if isinstance(error, OSError) and error.filename is not None:
        return tell(UserError(f"{error.filename}: {error.strerror}"), USER)
    raise error


def _fill_missing_streams() -> None:
    """Open standard streams that are closed on ``/dev/null``.

    Otherwise the shared memory or the port would get the number of a standard stream, and a child
    process would read from it or write to it.
    """
    for number, name in enumerate(("stdin", "stdout", "stderr")):
        try:
            os.fstat(number)
        except OSError:
            os.open(os.devnull, os.O_RDWR)  # takes the lowest free number: this one
        if getattr(sys, name) is None:
            setattr(sys, name, os.fdopen(number, "r" if number == 0 else "w", closefd=False))


class _Said(logging.Handler):
    """Prints the program's log messages on standard error."""

    def emit(self, record: logging.LogRecord) -> None:
        say(record.getMessage())


if __name__ == "__main__":
    sys.exit(main())
