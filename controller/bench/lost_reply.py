"""Measures the cost of a lost reply: how long each client waits for it.

The emulated bus drops replies. Its record also times the whole program: from the request whose
reply is lost to the next torque frame.
"""

from __future__ import annotations

import importlib
import os
import statistics
import tempfile
import time
from collections.abc import Callable, Iterable
from contextlib import ExitStack
from importlib.metadata import version
from pathlib import Path
from types import ModuleType
from typing import Final

from haptic_wall.controller.bench.loops import BAUD, emulated_bus, ours
from haptic_wall.controller.bench.rows import Measurement, Section
from haptic_wall.controller.emulated_bus.record import BusRow, read_rows
from haptic_wall.controller.errors import PlatformError
from haptic_wall.controller.settings.shares import COLLECT_SHARE
from haptic_wall.hw.clock import MonotonicClock
from haptic_wall.hw.dynamixel.codec import Instruction
from haptic_wall.hw.dynamixel.exchange import Exchange
from haptic_wall.hw.errors import Problem
from haptic_wall.hw.serialport.line import FdLine
from haptic_wall.hw.servo import Outcome

_PERIOD_NS: Final = 1_000_000
_ROUNDS, _LOSSES, _MOST_READS = 5, 8, 200
"""Losses of each client in each round; number of reads before giving up"""
_EVERY, _RARELY = 5, 20
"""Every n-th reply is dropped: for clients alone, and in a run"""
_RUN_S = 2.0
_START_S = 0.2
"""Ignored beginning of the run [s]"""
_ADDRESS, _BYTES = 120, 16

Read = Callable[[], bool]
"""Requests one reply; returns whether it came"""


def measure() -> Section:
    """Measure the time from a request to the next action after a lost reply, in periods of 1 ms.

    Raises:
        ServoError: The servo could not be started.
        PlatformError: The bus or the loop could not be started, or no reply was lost.
    """
    notes = [
        f"{name} is not installed, so nothing is compared with it"
        for name in ("dynamixel-sdk", "rustypot")
        if _module(name.replace("-", "_")) is None
    ]
    rows = _whole_program()
    with emulated_bus(faults=[f"drop:every={_EVERY},way=reply"]) as path, ExitStack() as stack:
        waits = waits_ns(_clients(path, stack), _ROUNDS)
    for name, each in waits.items():
        if not each:
            raise PlatformError(
                Problem(f"{name}: no reply was lost in {_MOST_READS} reads", advice="try again")
            )
        what = f"{name}, from a request whose reply is lost to going on"
        rows += _figures(what, [wait / _PERIOD_NS for wait in each])
    return Section(tuple(rows), tuple(notes))


def waits_ns(clients: dict[str, Read], rounds: int) -> dict[str, list[int]]:
    """Return the durations of each client's failed reads [ns], in short turns."""
    waits: dict[str, list[int]] = {name: [] for name in clients}
    for counted in range(1, rounds + 1):
        for name, read in clients.items():
            for _ in range(_MOST_READS):
                began_ns = time.monotonic_ns()
                if not read():
                    waits[name].append(time.monotonic_ns() - began_ns)
                if len(waits[name]) >= counted * _LOSSES:
                    break
    return waits


def request_to_torque_s(rows: Iterable[BusRow]) -> list[float]:
    """Return the times from each read request with a dropped reply to the next torque frame [s]."""
    asked_s, dropped, taken = 0.0, False, []
    for row in rows:
        if row.event == "fault":
            dropped = True
        elif row.event == "rx" and row.instruction == Instruction.READ:
            asked_s, dropped = row.time_s, False
        elif row.event == "rx" and row.instruction == Instruction.SYNC_WRITE:
            if dropped:
                taken.append(row.time_s - asked_s)
            dropped = False
    return taken


def _whole_program() -> list[Measurement]:
    """Return the rows of a run."""
    with tempfile.TemporaryDirectory() as folder:
        record = Path(folder) / "bus.csv"
        fault = f"drop:every={_RARELY},way=reply"
        with emulated_bus(faults=[fault], record=str(record)) as path:
            missed = ours(path, _RUN_S, 1e9 / _PERIOD_NS, 1).skipped
        seen = read_rows(record)
    torques = [row.time_s for row in seen if row.instruction == Instruction.SYNC_WRITE]
    begin_s = torques[-1] - _RUN_S + _START_S if torques else 0.0
    taken = request_to_torque_s(row for row in seen if row.time_s > begin_s)
    if not taken:
        raise PlatformError(
            Problem("no reply was lost in a run", advice="the machine is too busy, try again")
        )
    what = "haptic-wall run, from a request whose reply is lost to its torque frame"
    periods = [1e9 * each / _PERIOD_NS for each in taken]
    return [
        *_figures(what, periods),
        Measurement(
            f"haptic-wall run, periods skipped while {len(taken)} replies were lost",
            missed,
            "1",
        ),
    ]


def _figures(what: str, periods: list[float]) -> list[Measurement]:
    return [
        Measurement(f"{what}, median", statistics.median(periods), "periods"),
        Measurement(f"{what}, longest", max(periods), "periods"),
    ]


def _clients(path: str, stack: ExitStack) -> dict[str, Read]:
    """Return one read of each client, as a loop of this period would use it."""
    line = FdLine(os.open(path, os.O_RDWR | os.O_NOCTTY), MonotonicClock())
    stack.callback(line.close)
    exchange = Exchange(line, [1])

    def of_ours() -> bool:
        exchange.request()
        deadline_ns = time.monotonic_ns() + int(COLLECT_SHARE * _PERIOD_NS)
        return exchange.collect(deadline_ns)[0].outcome is Outcome.OK

    clients: dict[str, Read] = {"haptic-wall, driver": of_ours}
    sdk = _module("dynamixel_sdk")
    if sdk is not None:
        port = sdk.PortHandler(path)
        port.baudrate = BAUD
        port.openPort()
        stack.callback(port.closePort)
        handler = sdk.PacketHandler(2.0)
        clients[f"dynamixel-sdk {version('dynamixel-sdk')} as it comes"] = lambda: bool(
            handler.readTxRx(port, 1, _ADDRESS, _BYTES)[1] == sdk.COMM_SUCCESS
        )
    module = _module("rustypot")
    if module is not None:  # the last: it locks the port
        client = module.Xl430PyController(path, BAUD, 1e-9 * _PERIOD_NS)
        stack.callback(client.close)

        def of_rustypot() -> bool:
            try:
                client.read_raw_data(1, _ADDRESS, _BYTES)
            except RuntimeError:
                return False
            return True

        clients[f"rustypot {version('rustypot')} with a timeout of one period"] = of_rustypot
    return clients


def _module(name: str) -> ModuleType | None:
    """Return the module, or None if it is not installed."""
    try:
        return importlib.import_module(name)
    except ImportError:
        return None
