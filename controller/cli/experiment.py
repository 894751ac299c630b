"""Shared frame of the experiments' commands: options, consent to move, files, answer.

A command is a function of ``Asked`` and of its own options, under ``experiment``. One that writes a
report and a picture asks ``results_in`` for their folder, and ends with ``conclude``.
"""

from __future__ import annotations

import csv
import sys
from collections.abc import Callable, Iterable, Mapping
from contextlib import AbstractContextManager, ExitStack
from dataclasses import dataclass
from functools import partial, wraps
from pathlib import Path
from typing import Any

import click

from haptic_wall.controller.cli.drawing import drawn_or_noted
from haptic_wall.controller.cli.options import (
    answer,
    as_json,
    axis_option,
    config_argument,
    json_option,
    say,
    set_option,
    writing,
    written,
)
from haptic_wall.controller.cli.places import force_option, new_stem, take_folder
from haptic_wall.controller.cli.working import Work, working
from haptic_wall.controller.errors import UserError
from haptic_wall.controller.settings.config import Config
from haptic_wall.controller.settings.load import Loaded, file_of, load_axis
from haptic_wall.controller.system.files import whole
from haptic_wall.controller.system.json_text import RESULT_MARK
from haptic_wall.hw.open import find_port

_FASTER = 20.0
"""The simulated clock than real time"""
REACH = 0.6
"""Default excursion of an identification, to each side [rad]"""
_CONFIG = config_argument()
_YES = click.option("--yes", is_flag=True, help="Do not ask before a real servo moves.")


@dataclass(frozen=True, slots=True)
class Asked:
    """The options that all experiments share."""

    loaded: Loaded
    file: Path | None
    """The configuration's file; None for a preset"""
    out: Path | None
    """Argument of ``--out``"""
    yes: bool
    """Consent to move is already given"""
    sets: tuple[str, ...] = ()
    """Arguments of ``--set``"""

    @property
    def config(self) -> Config:
        """Return the effective configuration."""
        return self.loaded.config

    @property
    def name(self) -> str:
        """Return the configuration's name, for messages."""
        return self.loaded.name

    def may_move(self) -> None:
        """Wait for a person's consent before a real servo moves by itself.

        Raises:
            click.Abort: Consent is refused.
        """
        servo = self.config.servo
        if servo.kind != "hardware" or self.yes or not sys.stdin.isatty():
            return
        say(
            "keep the shaft's way free and the power switch within reach; Ctrl-C ends the motion at"
            " any time and switches the torque off"
        )
        click.confirm(f"May servo {servo.id} at {servo.port} move?", abort=True, err=True)


def experiment(
    out: Callable[[Any], Any],
    config: Callable[[Any], Any] = _CONFIG,
    *,
    moves: bool = True,
    of_walls: bool = False,
    filters: bool = False,
) -> Callable[[Callable[..., None]], Callable[..., None]]:
    """Give a command CONFIG and the options of all experiments, as ``Asked``; None: no CONFIG.

    Args:
        out: The option ``--out``, as ``folder_option`` makes it.
        config: The argument CONFIG.
        moves: The command has ``--yes``.
        of_walls: It measures a wall, and refuses any other law.
        filters: It counts ``wall.velocity_filter``; others refuse it.
    """

    def decorated(function: Callable[..., None]) -> Callable[..., None]:
        @wraps(function)
        def command(
            config: str | None,
            sets: tuple[str, ...],
            out: Path | None,
            axis: str | None,
            yes: bool = False,
            **own: Any,  # noqa: ANN401 - the command's own options
        ) -> None:
            asked = None
            if config is not None:
                loaded = load_axis(config, sets, axis, runs=not of_walls)
                refuse_unknown(loaded, of_walls=of_walls, filters=filters)
                asked = Asked(loaded, file_of(config), out, yes, sets)
                servo = asked.config.servo
                if moves and servo.kind == "hardware" and (yes or sys.stdin.isatty()):
                    find_port(servo.port or "")  # before any work
            function(asked, **own)

        last = (out, axis_option, set_option, config)
        for option in (json_option, force_option, *[_YES] * moves, *last):
            command = option(command)
        return command

    return decorated


def refuse_unknown(loaded: Loaded, *, of_walls: bool, filters: bool) -> None:
    """Refuse a wall that has what a command does not know; see ``experiment``.

    Raises:
        UserError: It has.
    """
    section = f"axes.{loaded.axis}.wall" if loaded.axis else "wall"
    for name, known, wanted, why in (
        ("law", not of_walls, "wall", "only walls are measured"),
        ("velocity_filter", filters, "none", "only the experiment zwidth knows a filter"),
    ):
        found = getattr(loaded.config.wall, name)
        if not known and found != wanted:
            raise UserError(
                f"found {found}",
                field=f"wall.{name}",
                wanted=f"{wanted}: {why}",
                advice=f"give --set {section}.{name}={wanted}; haptic-wall run renders {found}",
            )


def folder_option(text: str, *, needed: bool = False) -> Callable[[Any], Any]:
    """``--out DIR``."""
    kind = click.Path(path_type=Path)
    return click.option("--out", type=kind, metavar="DIR", help=text, required=needed)


def results_in(
    asked: Asked, what: str, kinds: Iterable[str] = ("json", "png"), others: Iterable[str] = ()
) -> Path:
    """Return the folder for the results, refused before any work if files there would be lost.

    Args:
        asked: The options.
        what: The command; its files are called so.
        kinds: Suffixes of these files.
        others: Files that keep what an earlier call has found, which this one continues.

    Raises:
        UserError: The files cannot be written.
    """
    folder = asked.out
    if folder is None:
        return new_stem("--out", what)
    with writing("--out", folder):
        begun = any((folder / name).exists() for name in others)  # it is continued
    take_folder("--out", folder, () if begun else [f"{what}.{kind}" for kind in kinds])
    return folder


def conclude(
    asked: Asked,
    what: str,
    folder: Path,
    report: Mapping[str, Any],
    text: Iterable[str],
    draw: Callable[[str, Path], None] | None = None,
    rows: Iterable[Mapping[str, Any]] | None = None,
) -> None:
    """Write the report, the table and the picture, and answer.

    Args:
        asked: The options.
        what: The command; JSON, picture and table are called so.
        folder: For these files.
        report: JSON-ready values.
        text: Lines of the answer for people; those of the files written follow.
        draw: Draws the picture, with a title, to a path; None: there is none.
        rows: Rows of the CSV table; None: there is none.

    Raises:
        UserError: The files cannot be written.
    """
    held = {**RESULT_MARK, "name": asked.name, **report}
    result, table, picture = (folder / f"{what}.{kind}" for kind in ("json", "csv", "png"))
    paths = [result]
    with writing("--out", folder), ExitStack() as all_or_none:
        folder.mkdir(parents=True, exist_ok=True)  # it may have gone meanwhile
        if rows is not None:
            _write_table(all_or_none.enter_context(whole(table)), rows)
            paths.append(table)
        if draw and drawn_or_noted("--out", picture, partial(draw, asked.name)):
            paths.append(picture)
        held["files"] = paths
        part = all_or_none.enter_context(whole(result))
        part.write_text(as_json(held) + "\n", encoding="utf-8")
    answer(held, lambda: "\n".join([*text, "", *written(paths)]))


def _write_table(path: Path, rows: Iterable[Mapping[str, Any]]) -> None:
    """Write rows of equal keys as CSV; lists as one cell."""
    plain = [
        {k: "; ".join(map(str, v)) if isinstance(v, list) else v for k, v in row.items()}
        for row in rows
    ]
    with path.open("w", newline="", encoding="utf-8") as stream:
        if plain:
            writer = csv.DictWriter(stream, list(plain[0]))
            writer.writeheader()
            writer.writerows(plain)


def moving(config: Config, seconds: float) -> AbstractContextManager[Work]:
    """Show that a servo is being moved.

    Args:
        config: Configuration of the servo.
        seconds: Approximate duration in real time [s].
    """
    simulated = config.loop.clock == "simulated"
    return working("measuring", seconds / _FASTER if simulated else seconds)
