"""Every error has its exit status and one clear message; standard output is the answer's alone."""

import errno
import subprocess
from pathlib import Path
from typing import NoReturn

import click
import pytest

from haptic_wall.controller.cli import main as program
from haptic_wall.controller.errors import PlatformError
from haptic_wall.hw.errors import PortBusyError
from tests.support.program import PROGRAM, Cli, python


def raising(monkeypatch: pytest.MonkeyPatch, error: BaseException) -> None:
    """Have ``haptic-wall presets`` meet an error."""

    def fail() -> NoReturn:
        raise error

    monkeypatch.setitem(program.COMMANDS, "presets", "")
    monkeypatch.setattr(
        "haptic_wall.controller.cli.presets.command", click.Command("presets", callback=fail)
    )


def test_help_lists_the_commands_without_importing_them() -> None:
    code = (
        "import sys; from haptic_wall.controller.cli.main import main; main(['--help']);"
        "print(*[m for m in ('numpy', 'pydantic', 'matplotlib', 'serial') if m in sys.modules],"
        " file=sys.stderr)"
    )
    done = python("-c", code)
    assert (done.returncode, done.stderr.strip()) == (0, "")
    for name, line in program.COMMANDS.items():
        assert f"{name} " in done.stdout
        assert line in " ".join(done.stdout.split())


@pytest.mark.parametrize("name", program.COMMANDS)
def test_every_command_has_help(cli: Cli, name: str) -> None:
    status, out, _ = cli(name, "--help")
    assert status == 0
    assert "Usage: haptic-wall " + name in out
    assert "\\b" not in out, "click's mark for lines to be left alone, shown as text"


def test_short_version_and_help(cli: Cli) -> None:
    assert cli("-V").out.startswith("haptic-wall, version ")
    assert "Commands:" in cli("-h").out
    assert cli("run", "-h").out.startswith("Usage: haptic-wall run ")


@pytest.mark.parametrize(
    ("error", "status", "said"),
    [
        (PortBusyError("/dev/ttyUSB0 is held by another program; close it"), 4, "close it"),
        (PlatformError("no"), 4, "no"),
        (KeyboardInterrupt(), 130, "interrupted"),
        (click.FileError("x"), 2, "x"),
        (PermissionError(13, "Permission denied", "runs"), 2, "runs"),
        (OSError(errno.EMFILE, "Too many open files"), 4, "raise the limits of this shell"),
        (MemoryError(), 4, "raise the limits of this shell"),
    ],
)
def test_exit_status_of_foreseen_errors(
    monkeypatch: pytest.MonkeyPatch, cli: Cli, error: BaseException, status: int, said: str
) -> None:
    raising(monkeypatch, error)
    found, out, err = cli("presets")
    assert found == status
    assert out == ""
    assert said in err and "Traceback" not in err


def test_the_exit_status_is_the_commands_own_when_the_reader_has_left() -> None:
    script = (
        "import os, sys; from haptic_wall.controller.cli.main import main;"
        "end, other = os.pipe(); os.close(end); os.dup2(other, 1);"
        "sys.exit(main(sys.argv[1:]))"
    )
    done = python("-c", script, "config", "--json")
    assert (done.returncode, done.stderr) == (0, "")


def test_a_full_disk_is_told_in_a_sentence() -> None:
    with Path("/dev/full").open("w") as full:
        done = subprocess.run(
            [*PROGRAM, "presets"], stdout=full, stderr=subprocess.PIPE, text=True, check=False
        )
    assert done.returncode == 4
    assert "the system refuses a resource: No space left on device: make room" in done.stderr
    assert done.stderr.count("\n") == 1
