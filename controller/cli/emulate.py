"""``haptic-wall emulate``: emulates a Dynamixel bus with moving servos, on a pseudo-terminal."""

from __future__ import annotations

import os
from dataclasses import replace
from pathlib import Path
from typing import Any, Final

import click

from haptic_wall.controller.cli import interrupt
from haptic_wall.controller.cli.numbers import AnyType, Number
from haptic_wall.controller.cli.options import say
from haptic_wall.controller.cli.places import FileToWrite, force_option, is_forced
from haptic_wall.controller.emulated_bus.program import NAMES, PRIORITY, Plan, run_bus, servo_of
from haptic_wall.controller.errors import PlatformError, UserError
from haptic_wall.controller.runtime import realtime
from haptic_wall.hw.dynamixel.registers import BAUD_RATES
from haptic_wall.hw.emulated.adapter import BLOCKS
from haptic_wall.hw.emulated.faults import KINDS, suggestion
from haptic_wall.hw.errors import Problem, SpecError
from haptic_wall.hw.truth import ARM, read

_TERMINALS: Final = Path("/dev/pts")


class _TrueValue(AnyType):
    """A true parameter, as section (``servo``, ``servo@ID`` or ``arm``), name and value."""

    name = "true parameter"

    def convert(
        self,
        value: Any,  # noqa: ANN401 - click's signature
        param: click.Parameter | None,
        ctx: click.Context | None,
    ) -> tuple[str, str, Any]:
        """Read the value; refuse an unknown name, and a value out of range."""
        path, equals, text = str(value).partition("=")
        section, _, name = path.strip().partition(".")
        if not equals:
            self.fail(f"found {value} without a value, wanted servo.NAME=VALUE", param, ctx)
        kind, at, id_ = section.partition("@")
        known = [each.partition(".")[2] for each in ARM] if section == "arm" else NAMES
        if section != "arm" and (kind != "servo" or id_.isdecimal() != bool(at)):
            known = ()
        if name not in known:
            near = suggestion(name or section, known or NAMES, f"{section if known else 'servo'}.")
            self.fail(f"an emulated servo has no {path}; {near}", param, ctx)
        full = {"arm": f"arm.{name}"}.get(section, "position" if name == "kick" else name)
        try:
            return section, name, read(full, text)
        except SpecError as error:
            self.fail(f"{path}: {error}", param, ctx)


@click.command()
@click.option("--servo", "servos", multiple=True, default=("XM430-W350:1",), show_default=True,
              metavar="MODEL[:ID[:FIRMWARE]]",
              help="A servo on the bus (repeatable). Default id: 1. Replies of two servos with one "
              "id collide.")  # fmt: skip
@click.option("--baud", type=Number(1, 1e7, whole=True), default=4_000_000, show_default=True,
              metavar="RATE",
              help="Baud rate of the servos. The factory setting of real ones is 57600, too slow "
              "for 1 kHz.")  # fmt: skip
@click.option("--link", type=click.Path(path_type=Path),
              help="Path of a symbolic link to the terminal; it exists while the bus "
              "runs.")  # fmt: skip
@click.option("--record", type=FileToWrite(),
              help="Write every frame and the true motion to this CSV file.")  # fmt: skip
@click.option("--latency-timer", type=Number(0, 255, whole=True), default=0, show_default=True,
              metavar="MS",
              help="Latency timer of the USB adapter, 1 to 255; 0: the adapter forwards replies at "
              "once.")  # fmt: skip
@click.option("--block", type=Number(1, 4096, whole=True), default=BLOCKS[-1], show_default=True,
              metavar="BYTES",
              help="Size of a block that the adapter forwards without waiting: "
              f"{BLOCKS[0]} on full-speed parts, {BLOCKS[1]} on high-speed ones.")  # fmt: skip
@click.option("--fault", "faults", multiple=True, metavar="SPEC",
              help="Fault to inject (repeatable), e.g. "
              + ", ".join(kind.example for kind in KINDS.values())
              + ". While the bus runs, each line on standard input injects one more; `off NAME` "
              "ends a fault, `list` lists them.")  # fmt: skip
@click.option("--seed", type=int, default=0, show_default=True,
              help="Seed of the servos' clocks and of the random faults.")  # fmt: skip
@click.option("--arm", type=click.Choice(["none", "planar"]), default="none", show_default=True,
              help="Links between the servos. planar: the first two move two links in a horizontal "
              "plane, with a mass at the end of each.")  # fmt: skip
@click.option("--set", "sets", multiple=True, metavar="servo.NAME=VALUE", type=_TrueValue(),
              help="True parameter of the servos (repeatable), of one of them as "
              "servo@ID.NAME=VALUE: " + ", ".join(NAMES) + "; or of the links: "
              + ", ".join(ARM) + ". SI units.")  # fmt: skip
@force_option
def command(
    servos: tuple[str, ...],
    sets: tuple[tuple[str, str, Any], ...],
    arm: str,
    link: Path | None,
    record: Path | None,
    **given: Any,  # noqa: ANN401 - the fields of a plan
) -> int:
    """Emulate a Dynamixel bus, byte for byte, with servos that move in real time.

    The path of its pseudo-terminal is the first line on standard output; a serial
    client opens it that needs no modem lines, RS-485 or parity. The bus runs until Ctrl-C.
    """
    if given["baud"] not in BAUD_RATES:
        wanted = f"one of {', '.join(map(str, BAUD_RATES))}"
        raise UserError(f"found {given['baud']}", field="--baud", wanted=wanted)
    if link is not None:
        _refuse_foreign(link)
    for name, path in (("link", link), ("record", record)):
        given[name] = path and str(path)
    sections: dict[str, dict[str, Any]] = {"servo": {}, "arm": {}}
    for section, name, value in sets:
        sections.setdefault(section, {})[name] = value
    truth, links = sections.pop("servo"), {"shape": arm} | sections.pop("arm")
    own = {section.partition("@")[2]: values for section, values in sections.items()}
    plan = Plan(servos, truth, own, links, **given)
    for setting in realtime.apply("best-effort", PRIORITY, os.sched_getaffinity(0)):
        if setting.name == "scheduler" and not setting.ok:
            say(f"replies may be late on a busy machine: {setting.wanted} was {setting.found}; "
                f"{setting.fix}")  # fmt: skip
    try:
        if len({servo_of(each)[1] for each in servos}) < len(servos):
            say("two servos have one id: as on a real bus both obey and answer, and their replies"
                " collide; give each an id of its own unless you want this")  # fmt: skip
        with interrupt.until_signal() as came:
            failure = run_bus(plan, lambda: bool(came), say)
    except SpecError as error:
        found = error.problem
        raise UserError(replace(found, field=found.field or "--servo")) from error
    except FileExistsError as error:
        raise UserError(error, field="--link", advice="name another place") from error
    except ValueError as error:
        raise UserError(error) from error
    if failure is not None:
        what = f"the record is incomplete: {failure.strerror}"
        advice = "make room, or name another place (the bus was not disturbed)"
        raise PlatformError(Problem(what, advice=advice, field="--record", given=str(record)))
    return interrupt.status_after(came)


def _refuse_foreign(link: Path) -> None:
    """Refuse a link of somebody else, or of a bus that runs."""
    left_behind = not link.exists() and link.is_symlink() and link.readlink().parent == _TERMINALS
    if link.is_symlink() and not left_behind and not is_forced():
        raise UserError(
            f"found a link to {link.readlink()}, which would be lost",
            field="--link",
            given=link,
            advice="name another place, or give --force to replace it",
        )
