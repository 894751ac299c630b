"""Starts and ends the emulated bus of a run or of an examination."""

from __future__ import annotations

import json
import os
import signal
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import asdict
from pathlib import Path
from typing import Any

from haptic_wall.controller.emulated_bus.bus import PROGRAM
from haptic_wall.controller.processes.children import Child, first_line
from haptic_wall.controller.processes.loop_watch import END_S, START_S
from haptic_wall.controller.runtime.telemetry import Word
from haptic_wall.hw.elastic import PLACE, SENT, TAKEN
from haptic_wall.hw.errors import Problem, ServoError
from haptic_wall.hw.settings import ServoSettings


def emulator_arguments(
    servos: Sequence[ServoSettings],
    witness: Path | None = None,
    *,
    hand: int | None = None,
    elastic: int | None = None,
) -> list[str]:
    """Return the arguments after ``python -m`` that start an emulated bus.

    Args:
        servos: Settings of the servos; their truth must be known.
        witness: Where the bus keeps a record; None: nowhere.
        hand: Descriptor of the memory of a person's hand on the shaft, inherited; None: none.
        elastic: Descriptor of the memory of the time that it shares with the loop; None: none.
    """
    first = servos[0]
    plan: dict[str, Any] = {
        "servos": [f"{one.model}:{one.id}" for one in servos],
        "own": {str(one.id): asdict(one.true) for one in servos if one.true is not None},
        "arm": asdict(first.arm) if first.arm and first.arm.shape != "none" else {},
        "baud": first.baud,
        "faults": list(first.faults),
        "seed": first.fault_seed,
        "record": None if witness is None else str(witness),
        "starter": os.getpid(),
        "hand": hand,
        "elastic": elastic,
    }
    return [PROGRAM, json.dumps(plan)]


@contextmanager
def emulated_bus(
    arguments: list[str],
    cores: set[int],
    stopped: Callable[[], bool] = lambda: False,
    descriptors: Sequence[int] = (),
) -> Iterator[tuple[Child, str | None]]:
    """Run an emulated bus in a separate process during the block.

    Args:
        arguments: As from ``emulator_arguments``.
        cores: Cores on which it may run.
        stopped: Called during the start; true: the bus is no longer wanted.
        descriptors: Inherited by it.

    Yields:
        The process, and the path of its port; None: it was stopped before it had one.

    Raises:
        ServoError: It does not start.
    """
    bus = Child("emulator", arguments, None, descriptors, cores)
    try:
        path = first_line(bus, START_S, stopped)
        if path is None and stopped():
            bus.send(signal.SIGKILL)  # one that hangs need not heed anything else
        elif path is None:
            how = "" if bus.ended() else bus.doing()
            what = f"the emulated bus did not start: it {how or bus.exit_text()}"
            advice = "see its message above, if any, and start again"
            raise ServoError(Problem(what, advice=advice))
        yield bus, path
    finally:
        bus.dismiss(END_S)


def failure_of(bus: Child | None, words: memoryview[int]) -> str:
    """Say how a run's own bus ended, or that it hangs; empty: neither, or there is none."""
    if bus is None:
        return ""
    if bus.ended():
        return f"the emulated bus {bus.exit_text()}"
    doing = bus.doing()
    hangs = words[Word.COUPLED] and words[PLACE + TAKEN] != words[PLACE + SENT]
    if hangs or "stopped" in doing:
        return f"the emulated bus {doing or 'hung'}, and took no more bytes"
    return ""
