"""The process of an emulated bus: servos that move in real time, behind a pseudo-terminal.

``python -m haptic_wall.controller.emulated_bus.program`` takes a ``Plan`` as JSON. It ends with its
parent, on SIGTERM or on Ctrl-C. ``haptic-wall emulate`` calls ``run_bus``.
"""

from __future__ import annotations

import json
import math
import os
import random
import sys
import time
from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack, suppress
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Final

from haptic_wall.controller.runtime import realtime
from haptic_wall.controller.system.printable import printable
from haptic_wall.controller.system.signals import on_signals
from haptic_wall.hw.dynamixel.registers import TICK_MODULUS
from haptic_wall.hw.dynamixel.tables import MODELS, Model
from haptic_wall.hw.elastic import BusClock, shared_words
from haptic_wall.hw.emulated.adapter import BLOCKS, Adapter
from haptic_wall.hw.emulated.bus import EmulatedBus
from haptic_wall.hw.emulated.console import Console
from haptic_wall.hw.emulated.faults import suggestion
from haptic_wall.hw.emulated.injection import Faults
from haptic_wall.hw.emulated.server import PseudoTerminal, serve
from haptic_wall.hw.emulated.servo import EmulatedServo
from haptic_wall.hw.emulated.witness import Witness
from haptic_wall.hw.errors import SpecError
from haptic_wall.hw.hand import SharedHand
from haptic_wall.hw.open import other_model
from haptic_wall.hw.truth import ABOUT, TrueArm, TrueServo

PRIORITY: Final = 70
"""Of SCHED_FIFO where it is granted: below the controller's loop"""
# An MX-64: no identification of an XM430 is published.
# Source: Rhoban "bam" identification, Coulomb and viscous model (Apache-2.0).
DEFAULT_TRUTH: Final = TrueServo(
    inertia=0.011951,
    damping=0.011692,
    coulomb=0.09039,
    position=math.pi,
    hand_origin=math.pi,
)
NAMES: Final = (*ABOUT, "kick")
"""Names of true parameters; ``kick``: the start's displacement from the wall"""
_MS_NS = 1_000_000


@dataclass(frozen=True, slots=True)
class Plan:
    """An emulated bus."""

    servos: Sequence[str]
    """``MODEL[:ID[:FIRMWARE]]`` each"""
    truth: Mapping[str, Any] = field(default_factory=dict)
    """True parameters of all servos, by name; others have the defaults of the model"""
    own: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)
    """Those of single servos, by id; they come before the ones of all"""
    arm: Mapping[str, Any] = field(default_factory=dict)
    """Fields of ``TrueArm``; empty: the servos are not coupled"""
    baud: int = 4_000_000
    """[bit/s]"""
    latency_timer: int = 0
    """Of the USB adapter [ms]; 0: it forwards replies at once"""
    block: int = BLOCKS[-1]
    """Bytes that the adapter forwards without waiting"""
    faults: Sequence[str] = ()
    seed: int = 0
    """Of the servos' clocks and the random faults"""
    link: str | None = None
    """Path of a symbolic link to the terminal"""
    record: str | None = None
    """Path of the CSV record"""
    hand: int | None = None
    """Inherited descriptor of the memory of a person's hand"""
    elastic: int | None = None
    """Inherited descriptor of the memory of a time shared with a loop"""
    starter: int | None = None
    """Process id of the run that starts this bus, which may end before it is there"""
    owner: int | None = None
    """Process id of the only reader of the record, without which nothing is left behind"""


def run_bus(
    plan: Plan,
    stopped: Callable[[], bool],
    complain: Callable[[str], None],
) -> OSError | None:
    """Run a bus until ``stopped``; the path of its terminal is the first line on standard output.

    Args:
        plan: The bus.
        stopped: Called every 10 ms.
        complain: Says why a line on standard input is no fault.

    Returns:
        Why the record is incomplete; None: it is complete, or there is none.

    Raises:
        SpecError: A servo, its truth, the arm or a fault is wrong; the field is the option of
            ``emulate``.
        ValueError: They do not fit together.
        OSError: Terminal, link or record cannot be made.
    """
    ids = [servo_of(each) for each in plan.servos]
    if missing := set(plan.own) - {str(each[1]) for each in ids}:
        raise SpecError(f"no servo has the id {min(missing)}", field="--set")
    links = [name for name in plan.arm if name != "shape"]
    if links and plan.arm.get("shape", "none") == "none":
        what = f"found arm.{links[0]}, but nothing links the servos"
        raise SpecError(what, field="--set", advice="add --arm planar")
    start_ns = time.monotonic_ns()
    ticks = random.Random(plan.seed)
    servos = [
        EmulatedServo(
            *each,
            truth_of(each[0], {**plan.truth, **plan.own.get(str(each[1]), {})}),
            start_ns=start_ns,
            baud=plan.baud,
            tick=ticks.randrange(TICK_MODULUS),
        )
        for each in ids
    ]
    if plan.hand is not None:
        for axis, servo in enumerate(servos):
            servo.take_hand(SharedHand(plan.hand, axis))
    timer_ns = plan.latency_timer * _MS_NS
    with ExitStack() as stack:
        try:
            faults = Faults(plan.faults, plan.seed)
            terminal = stack.enter_context(PseudoTerminal(Path(plan.link) if plan.link else None))
            witness = None
            if plan.record is not None:
                file = Path(plan.record).open("w", encoding="utf-8", newline="\n")  # noqa: SIM115
                witness = stack.enter_context(Witness(file))  # closes it
            bus = EmulatedBus(
                servos,
                baud=plan.baud,
                start_ns=start_ns,
                witness=witness,
                adapter=Adapter(timer_ns, plan.block, start_ns) if timer_ns else None,
                faults=faults,
                arm=TrueArm(**plan.arm),
            )
        except SpecError as error:
            field = error.problem.field or "--fault"
            raise SpecError(replace(error.problem, field=field)) from error
        console = Console(bus, sys.stdin.fileno(), _say, complain) if sys.stdin else None
        shared = None if plan.elastic is None else BusClock(shared_words(plan.elastic))
        realtime.freeze_garbage()
        _say(terminal.path)  # not before: a request would wait for the collection
        serve(bus, terminal, stopped, witness, console, _say, shared)
    return witness.failure if witness is not None else None


def servo_of(text: str) -> tuple[Model, int, int]:
    """Return model, id and firmware from MODEL[:ID[:FIRMWARE]].

    The default firmware is the first one with every emulated feature.

    Raises:
        SpecError: The model is unknown, or a number is invalid.
    """
    name, *rest = text.split(":")
    model = {known.upper(): found for known, found in MODELS.items()}.get(name.strip().upper())
    if model is None:
        advice = other_model(name) or f"known are {', '.join(MODELS)}"
        raise SpecError(f"no model {name!r} is known", field="--servo", advice=advice)
    numbers = [int(each) for each in rest if each.strip().isdecimal() and len(each) < 9]
    if len(numbers) != len(rest) or len(rest) > 2:
        raise SpecError(f"found {text[:40]}", field="--servo", wanted="MODEL[:ID[:FIRMWARE]]")
    id_, firmware = [*numbers, *(1, model.fast_sync_read_firmware)[len(numbers) :]]
    return model, id_, firmware


def truth_of(model: Model, given: Mapping[str, Any]) -> TrueServo:
    """Return the true parameters of an emulated servo: the given ones, and defaults of its model.

    Args:
        model: The model; its stall torque is the default torque limit.
        given: Values by name.

    Raises:
        SpecError: They are no servo's.
    """
    values = dict(given)
    unknown = next((name for name in values if name not in NAMES), None)
    if unknown is not None:
        advice = suggestion(unknown, NAMES, "servo.")
        raise SpecError("no such parameter", field=f"servo.{unknown}", advice=advice)
    if model.stall_torque is not None:
        values.setdefault("torque_limit", model.stall_torque)
    if "kick" in values:
        origin = values.get("hand_origin", DEFAULT_TRUTH.hand_origin)
        values["position"] = origin + values.pop("kick")
    try:
        return replace(DEFAULT_TRUTH, **values)
    except SpecError as error:
        problem = error.problem
        raise SpecError(replace(problem, field=f"servo.{problem.field}")) from error


def _say(text: str) -> None:
    with suppress(OSError):  # the parent may have stopped reading
        os.write(1, f"{printable(text)}\n".encode())


def _complain(text: str) -> None:
    with suppress(OSError):
        os.write(2, f"{printable(text)}\n".encode())


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


def main() -> int:
    """Run the bus of this process's argument; return its exit status."""
    plan = Plan(**json.loads(sys.argv[1]))
    orphaned = _orphaned(plan.owner or plan.starter)
    signals: list[int] = []

    realtime.apply("best-effort", PRIORITY, os.sched_getaffinity(0))
    try:
        with on_signals(lambda number, _frame: signals.append(number)):
            failure = run_bus(plan, lambda: bool(signals) or orphaned(), _complain)
    except (SpecError, ValueError, OSError) as error:
        _complain(f"emulated bus: {error}")
        return 2
    finally:
        if plan.owner is not None and plan.record is not None and orphaned():
            with suppress(OSError):
                Path(plan.record).unlink(missing_ok=True)
                Path(plan.record).parent.rmdir()
    if failure is not None:
        _complain(f"emulated bus: the record is incomplete: {failure.strerror}")
    return 0 if failure is None else 4


if __name__ == "__main__":
    sys.exit(main())
