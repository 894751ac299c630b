"""``haptic-wall emulate``: a Dynamixel bus with moving servos, on a pseudo-terminal."""

from __future__ import annotations

import difflib
import math
import os
import random
import signal
import time
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import ExitStack, contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any, get_args

import click

from controller import realtime
from controller.cli.options import writing
from controller.errors import PlatformError, UserError
from hw.dynamixel.emulated.bus import EmulatedBus
from hw.dynamixel.emulated.server import PseudoTerminal, serve
from hw.dynamixel.emulated.servo import EmulatedServo
from hw.dynamixel.emulated.witness import Witness
from hw.dynamixel.tables import MODELS, TICK_MODULUS, Model
from hw.settings import HandName, TrueServo

DEFAULT_BAUD = 4_000_000
PRIORITY = 70
"""Of SCHED_FIFO where it is granted: below the controller's loop"""
INTERRUPTED = 130

# An MX-64, for want of a published identification of an XM430.
# Source: Rhoban "bam" identification, Coulomb and viscous model (Apache-2.0).
DEFAULT_TRUTH = TrueServo(
    inertia=0.011951,
    damping=0.011692,
    coulomb=0.09039,
    position=math.pi,
    hand_origin=math.pi,
)


def _number(low: float, high: float, *, open_low: bool = False) -> Callable[[str], float]:
    def parse(text: str) -> float:
        value = float(text)
        if not (low < value if open_low else low <= value) or not value <= high:
            raise ValueError
        return value

    parse.__doc__ = f"a number {'above' if open_low else 'from'} {low:g} up to {high:g}"
    return parse


def _whole(low: int, high: int) -> Callable[[str], int]:
    def parse(text: str) -> int:
        value = float(text)
        if not value.is_integer() or not low <= value <= high:
            raise ValueError
        return int(value)

    parse.__doc__ = f"a whole number from {low} to {high}"
    return parse


def _one_of(*choices: Any) -> Callable[[str], Any]:  # noqa: ANN401 - texts or numbers
    def parse(text: str) -> Any:  # noqa: ANN401
        return {str(choice): choice for choice in choices}[text]

    parse.__doc__ = "one of " + ", ".join(map(str, choices))
    return parse


_TRUTH: Mapping[str, Callable[[str], Any]] = {
    "inertia": _number(0, 1e6, open_low=True),
    "damping": _number(0, 1e6),
    "coulomb": _number(0, 1e6),
    "counts_per_rev": _whole(0, 2**24),
    "delay": _number(0, 1),
    "torque_limit": _number(0, 1e6, open_low=True),
    "torque_step": _number(0, 1e6),
    "backlash": _number(0, 1),
    "torque_constant": _number(0, 1e6),
    "position": _number(-1e6, 1e6),
    "kick": _number(-100, 100),
    "hand": _one_of(*get_args(HandName)),
    "hand_origin": _number(-1e6, 1e6),
    "hand_direction": _one_of(1, -1),
}


@click.command()
@click.option(
    "--servo",
    "servos",
    multiple=True,
    default=("XM430-W350:1",),
    show_default=True,
    metavar="MODEL[:ID[:FIRMWARE]]",
    help="A servo on the bus (repeatable). The id is 1 unless given.",
)
@click.option(
    "--baud",
    default=str(DEFAULT_BAUD),
    show_default=True,
    metavar="RATE",
    help="Speed the servos listen at. Real ones come set to 57600, too slow for 1 kHz.",
)
@click.option(
    "--link",
    type=click.Path(path_type=Path),
    help="Keep a symbolic link to the terminal here while it runs.",
)
@click.option(
    "--record",
    type=click.Path(path_type=Path, dir_okay=False),
    help="Write every frame and the true motion to this CSV file.",
)
@click.option(
    "--seed", type=int, default=0, show_default=True, help="Decides where the servos' clocks start."
)
@click.option(
    "--set",
    "sets",
    multiple=True,
    metavar="servo.NAME=VALUE",
    help="What the servos truly are (repeatable): " + ", ".join(_TRUTH) + ". SI units.",
)
@click.option("--die-with-parent", is_flag=True, hidden=True)
def command(
    servos: tuple[str, ...],
    baud: str,
    link: Path | None,
    record: Path | None,
    seed: int,
    sets: tuple[str, ...],
    die_with_parent: bool,
) -> int:
    """Emulate a Dynamixel bus, byte for byte, with servos that move in real time.

    The path of its pseudo-terminal is the first line on standard output; any serial client can
    open it. Runs until interrupted.
    """
    signals: list[int] = []
    if die_with_parent:
        realtime.die_with_parent(os.getppid(), signal.SIGTERM)
    speed = _speed(baud)
    given = _given(sets)
    plan = [_servo(text) for text in servos]
    if len({id_ for _, id_, _ in plan}) < len(plan):
        raise UserError(
            "--servo: two servos have the same id; give each its own, e.g. --servo "
            f"{plan[0][0].name}:1 --servo {plan[1][0].name}:2"
        )
    with ExitStack() as stack:
        for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
            before = signal.signal(number, lambda received, _frame: signals.append(received))
            stack.callback(signal.signal, number, before)
        witness = None
        if record is not None:
            with writing("--record", record):
                file = record.open("w", encoding="utf-8", newline="\n")
            witness = stack.enter_context(Witness(file))
        with writing("--link", link or Path()), _as_user_error():
            terminal = stack.enter_context(PseudoTerminal(link))
        start_ns = time.monotonic_ns()
        ticks = random.Random(seed)
        with _as_user_error():
            emulated = [
                EmulatedServo(
                    model,
                    id_,
                    firmware,
                    truth_of(model, given),
                    start_ns=start_ns,
                    baud=speed,
                    tick=ticks.randrange(TICK_MODULUS),
                )
                for model, id_, firmware in plan
            ]
        bus = EmulatedBus(emulated, baud=speed, start_ns=start_ns, witness=witness)
        settings = realtime.apply("best-effort", PRIORITY, os.sched_getaffinity(0))
        realtime.freeze_garbage()
        click.echo(terminal.path)
        if not die_with_parent:
            _report(settings)
        serve(bus, terminal, lambda: bool(signals), witness)
    if witness is not None and witness.failure is not None:
        raise PlatformError(
            f"--record {record}: the record is incomplete: {witness.failure.strerror}; make room "
            "or name another place (the bus itself was not disturbed)"
        )
    return INTERRUPTED if signals[0] == signal.SIGINT else 0


def truth_of(model: Model, given: Mapping[str, Any]) -> TrueServo:
    """What a servo of this model truly is, with what was given in place of the defaults.

    Args:
        model: Its stall torque limits the torque unless that is given.
        given: Values by name, as ``--set servo.NAME`` takes them.
    """
    values = dict(given)
    if model.stall_torque is not None:
        values.setdefault("torque_limit", model.stall_torque)
    kick = values.pop("kick", None)
    true = replace(DEFAULT_TRUTH, **values)
    return true if kick is None else replace(true, position=true.hand_origin + kick)


def _given(sets: Iterable[str]) -> dict[str, Any]:
    """The values of ``--set``, by name.

    Raises:
        UserError: A name is unknown, or a value is none it can have.
    """
    given: dict[str, Any] = {}
    for text in sets:
        path, equals, value = text.partition("=")
        section, _, name = path.strip().partition(".")
        if not equals:
            raise UserError(f"--set {text}: no value; give servo.NAME=VALUE")
        if section != "servo" or name not in _TRUTH:
            hint = _suggestion(name or section, _TRUTH, "servo.")
            raise UserError(f"--set {path}: an emulated servo has no such value{hint}")
        parse = _TRUTH[name]
        try:
            given[name] = parse(value.strip())
        except (ValueError, KeyError):
            raise UserError(f"--set {path}: found {value!r}, wanted {parse.__doc__}") from None
    if "kick" in given and "position" in given:
        raise UserError("--set servo.kick and servo.position both say where it starts; give one")
    return given


def _servo(text: str) -> tuple[Model, int, int]:
    """Model, id and firmware from MODEL[:ID[:FIRMWARE]].

    The firmware is by default the first one that knows all that is emulated.

    Raises:
        UserError: The model is unknown, or a number is none.
    """
    name, *numbers = text.split(":")
    model = {known.upper(): found for known, found in MODELS.items()}.get(name.strip().upper())
    if model is None:
        raise UserError(
            f"--servo {text}: no model {name!r} is known{_suggestion(name.upper(), MODELS)}"
        )
    if len(numbers) > 2 or not all(number.strip().isdecimal() for number in numbers):
        raise UserError(f"--servo {text}: wanted MODEL[:ID[:FIRMWARE]], e.g. {model.name}:1:45")
    id_ = int(numbers[0]) if numbers else 1
    firmware = int(numbers[1]) if len(numbers) > 1 else model.fast_sync_read_firmware
    return model, id_, firmware


def _speed(text: str) -> int:
    try:
        return _whole(1, 10_000_000)(text)
    except ValueError:
        raise UserError(f"--baud: found {text!r}, wanted a speed such as {DEFAULT_BAUD}") from None


def _suggestion(found: str, known: Iterable[str], prefix: str = "") -> str:
    near = difflib.get_close_matches(found, list(known), n=1)
    return f"; did you mean {prefix}{near[0]}?" if near else f"; known are {', '.join(known)}"


@contextmanager
def _as_user_error() -> Iterator[None]:
    """What the emulator finds wrong with what it was given, the user gave."""
    try:
        yield
    except FileExistsError as error:
        raise UserError(f"--link: {error}; name another place") from error
    except ValueError as error:
        raise UserError(f"{error}") from error


def _report(settings: Iterable[realtime.Setting]) -> None:
    for setting in settings:
        if setting.name == "scheduler" and not setting.ok:
            click.echo(
                f"replies may be late on a busy machine: {setting.wanted} was {setting.got}; "
                f"{setting.remedy}",
                err=True,
            )
