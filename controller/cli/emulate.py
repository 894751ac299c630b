"""``haptic-wall emulate``: emulates a Dynamixel bus with moving servos, on a pseudo-terminal."""

from __future__ import annotations

import json
import os
import random
import signal
import sys
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import replace
from pathlib import Path

import click

from haptic_wall.controller.cli import interrupt
from haptic_wall.controller.cli.emulated_servos import NAMES, given_truth, servo_of, truth_of
from haptic_wall.controller.cli.options import refuse_same_file, say, writing
from haptic_wall.controller.cli.places import force_option, take_file, take_link
from haptic_wall.controller.errors import PlatformError, UserError
from haptic_wall.controller.runtime import realtime
from haptic_wall.controller.system.printable import printable
from haptic_wall.controller.system.signals import on_signals
from haptic_wall.hw.dynamixel.registers import TICK_MODULUS
from haptic_wall.hw.elastic import BusClock, shared_words
from haptic_wall.hw.emulated.adapter import BLOCKS, Adapter
from haptic_wall.hw.emulated.bus import EmulatedBus
from haptic_wall.hw.emulated.console import Console
from haptic_wall.hw.emulated.faults import KINDS, whole
from haptic_wall.hw.emulated.injection import Faults
from haptic_wall.hw.emulated.server import PseudoTerminal, serve
from haptic_wall.hw.emulated.servo import EmulatedServo
from haptic_wall.hw.emulated.witness import Witness
from haptic_wall.hw.errors import Problem, SpecError
from haptic_wall.hw.hand import SharedHand
from haptic_wall.hw.truth import TrueServo

DEFAULT_BAUD = 4_000_000
PRIORITY = 70
"""Of SCHED_FIFO where it is granted: below the controller's loop"""
_MS_NS = 1_000_000


@click.command()
@click.option(
    "--servo",
    "servos",
    multiple=True,
    default=("XM430-W350:1",),
    show_default=True,
    metavar="MODEL[:ID[:FIRMWARE]]",
    help="A servo on the bus (repeatable). Default id: 1. Replies of two servos with one id"
    " collide.",
)
@click.option(
    "--baud",
    default=str(DEFAULT_BAUD),
    show_default=True,
    metavar="RATE",
    help="Baud rate of the servos. The factory setting of real ones is 57600, too slow for 1 kHz.",
)
@click.option(
    "--link",
    type=click.Path(path_type=Path),
    help="Path of a symbolic link to the terminal; it exists while the bus runs.",
)
@click.option(
    "--record",
    type=click.Path(path_type=Path, dir_okay=False),
    help="Write every frame and the true motion to this CSV file.",
)
@click.option(
    "--latency-timer",
    default="0",
    show_default=True,
    metavar="MS",
    help="Latency timer of the USB adapter, 1 to 255; 0: the adapter forwards replies at once.",
)
@click.option(
    "--block",
    metavar="BYTES",
    help="Size of a block that the adapter forwards without waiting: "
    f"{BLOCKS[0]} on full-speed parts, {BLOCKS[1]} on high-speed ones.  [default: {BLOCKS[1]}]",
)
@click.option(
    "--fault",
    "faults",
    multiple=True,
    metavar="SPEC",
    help="Fault to inject (repeatable), e.g. "
    + ", ".join(kind.example for kind in KINDS.values())
    + ". While the bus runs, each line on standard input injects one more; `off NAME` ends a fault,"
    " `list` lists them.",
)
@click.option(
    "--seed",
    type=int,
    default=0,
    show_default=True,
    help="Seed of the servos' clocks and of the random faults.",
)
@click.option(
    "--set",
    "sets",
    multiple=True,
    metavar="servo.NAME=VALUE",
    shell_complete=lambda _context, _parameter, begun: [
        path for path in (f"servo.{name}=" for name in NAMES) if path.startswith(begun)
    ],
    help="True parameter of the servos (repeatable): " + ", ".join(NAMES) + ". SI units.",
)
@force_option
@click.option("--truth", hidden=True)  # of a run's own bus: a TrueServo as JSON
@click.option("--die-with-parent", is_flag=True, hidden=True)
@click.option("--owner", type=int, hidden=True)  # its parent, the only reader of the record
@click.option("--hand-memory", type=int, hidden=True)  # inherited memory of a person's hand
@click.option("--elastic", type=int, hidden=True)  # memory of a time shared with a loop
def command(
    servos: tuple[str, ...],
    baud: str,
    link: Path | None,
    record: Path | None,
    latency_timer: str,
    block: str | None,
    faults: tuple[str, ...],
    seed: int,
    sets: tuple[str, ...],
    force: bool,
    truth: str | None,
    die_with_parent: bool,
    owner: int | None,
    hand_memory: int | None,
    elastic: int | None,
) -> int:
    """Emulate a Dynamixel bus, byte for byte, with servos that move in real time.

    The path of its pseudo-terminal is the first line on standard output; a serial
    client opens it that needs no modem lines, RS-485 or parity. The bus runs until Ctrl-C.
    """
    signals: list[int] = []
    orphaned = _orphaned(owner) if die_with_parent else lambda: False
    speed = _speed(baud)
    timer_ms, block_size = _adapter(latency_timer, block)
    given = given_truth(sets)
    plan = [servo_of(text) for text in servos]
    refuse_same_file({"--record": record, "--link": link})
    with ExitStack() as stack:
        if owner is not None and record is not None:
            stack.callback(_leave_nothing, record, orphaned)
        stack.enter_context(on_signals(lambda received, _frame: signals.append(received)))
        witness = None
        if record is not None and not die_with_parent:  # else the parent has looked
            take_file("--record", record, force=force)
        if link is not None:
            take_link("--link", link, force=force)
        with _as_user_error():
            terminal = stack.enter_context(_terminal(link))
        start_ns = time.monotonic_ns()
        with _as_user_error():
            ticks = random.Random(seed)
            emulated = [
                EmulatedServo(
                    model,
                    id_,
                    firmware,
                    _own_truth(truth) if truth else truth_of(model, given),
                    start_ns=start_ns,
                    baud=speed,
                    tick=ticks.randrange(TICK_MODULUS),
                )
                for model, id_, firmware in plan
            ]
        if hand_memory is not None:
            emulated[0].take_hand(SharedHand(hand_memory))
        with _as_user_error("--fault"):
            mishaps = Faults(faults, seed)
        if record is not None:
            with writing("--record", record):
                file = record.open("w", encoding="utf-8", newline="\n")
            witness = stack.enter_context(Witness(file))
        with _as_user_error("--fault"):
            bus = EmulatedBus(
                emulated,
                baud=speed,
                start_ns=start_ns,
                witness=witness,
                adapter=Adapter(timer_ms * _MS_NS, block_size, start_ns) if timer_ms else None,
                faults=mishaps,
            )
        settings = realtime.apply("best-effort", PRIORITY, os.sched_getaffinity(0))
        realtime.freeze_garbage()
        click.echo(terminal.path)
        if not die_with_parent:
            _report(settings)
            _warn_of_shared_ids([id_ for _, id_, _ in plan])
        console = Console(bus, sys.stdin.fileno(), _say, say) if sys.stdin else None
        shared = None if elastic is None else BusClock(shared_words(elastic))
        serve(bus, terminal, lambda: bool(signals) or orphaned(), witness, console, _say, shared)
    if witness is not None and witness.failure is not None:
        what = f"the record is incomplete: {witness.failure.strerror}"
        advice = "make room, or name another place (the bus was not disturbed)"
        raise PlatformError(Problem(what, advice=advice, field="--record", given=str(record)))
    return interrupt.INTERRUPTED if signal.SIGINT in signals[:1] else 0


def _orphaned(owner: int | None) -> Callable[[], bool]:
    """Return a function that tells whether the process that started this one has ended.

    It does not use PR_SET_PDEATHSIG: that acts when the *thread* ends that started this process.

    Args:
        owner: Its process id: it may have ended before the first call; None: it has not.
    """
    parent = os.getppid()
    if owner is not None and owner != parent and not Path(f"/proc/{owner}").exists():
        return lambda: True
    return lambda: os.getppid() != parent


def _leave_nothing(record: Path, orphaned: Callable[[], bool]) -> None:
    """Remove a record in a folder of its own if no process is left to read it."""
    if orphaned():
        with suppress(OSError):
            record.unlink(missing_ok=True)
            record.parent.rmdir()


def _speed(text: str) -> int:
    try:
        return whole(1, 10_000_000)(text)
    except ValueError:
        raise UserError(
            f"found {text!r}", field="--baud", wanted=f"a speed such as {DEFAULT_BAUD}"
        ) from None


def _adapter(latency_timer: str, block: str | None) -> tuple[int, int]:
    """Return the adapter's timer [ms] and block size [bytes].

    Raises:
        UserError: One of them is invalid.
    """
    sizes = whole(1, 4096)
    try:
        timer_ms = whole(0, 255)(latency_timer)
    except ValueError:
        raise UserError(
            f"found {latency_timer!r}",
            field="--latency-timer",
            wanted="whole milliseconds from 1 to 255, or 0 for none",
        ) from None
    if block is None:
        return timer_ms, BLOCKS[-1]
    if not timer_ms:
        raise UserError(
            "without a latency timer the block size has no effect",
            field="--block",
            advice="give --latency-timer too",
        )
    try:
        return timer_ms, sizes(block)
    except ValueError:
        raise UserError(f"found {block!r}", field="--block", wanted=sizes.__doc__) from None


def _own_truth(text: str) -> TrueServo:
    """Return the true parameters that a run gives its own bus, from JSON."""
    try:
        return TrueServo(**json.loads(text))
    except TypeError:
        raise UserError(
            f"found {text}", field="--truth", wanted="the fields of a simulated servo as JSON"
        ) from None


def _say(text: str) -> None:
    with suppress(OSError):  # the parent may have stopped reading
        click.echo(printable(text))


def _terminal(link: Path | None) -> PseudoTerminal:
    """Open a pseudo-terminal, perhaps with a link to it."""
    try:
        os.close(os.open("/dev/ptmx", os.O_RDWR | os.O_NOCTTY))
    except OSError as error:
        raise PlatformError(
            f"no pseudo-terminal can be made (/dev/ptmx: {error.strerror})",
            advice="mount them: `sudo mount -t devpts devpts /dev/pts`; if many are open, end "
            "programs that hold them",
        ) from error
    with writing("--link", link or Path()):
        return PseudoTerminal(link)


@contextmanager
def _as_user_error(option: str | None = None) -> Iterator[None]:
    """Turn the emulator's errors about its arguments into the user's."""
    try:
        yield
    except FileExistsError as error:
        raise UserError(error, field="--link", advice="name another place") from error
    except SpecError as error:
        raise UserError(replace(error.problem, field=option)) from error
    except ValueError as error:
        raise UserError(error, field=option) from error


def _warn_of_shared_ids(ids: Sequence[int]) -> None:
    for id_ in sorted({id_ for id_ in ids if ids.count(id_) > 1}):
        say(
            f"{ids.count(id_)} servos have the id {id_}: as on a real bus all of them obey and "
            "answer, and their replies collide; give each an id of its own unless you want this"
        )


def _report(settings: Iterable[realtime.Setting]) -> None:
    for setting in settings:
        if setting.name == "scheduler" and not setting.ok:
            say(
                f"replies may be late on a busy machine: {setting.wanted} was {setting.got}; "
                f"{setting.remedy}"
            )
