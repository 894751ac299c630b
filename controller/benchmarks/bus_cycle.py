"""What a cycle on the bus costs a client: ours beside dynamixel-sdk and rustypot, on one port.

A cycle reads current, velocity and position (10 bytes) of every servo and writes every goal current
(2 bytes). All clients have the same emulated bus open and take turns.
"""

from __future__ import annotations

import importlib
import os
import statistics
import struct
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from importlib.metadata import version
from types import ModuleType
from typing import Final, Protocol

from controller.benchmarks.rows import Row, Section
from controller.errors import PlatformError
from controller.processes import Child, first_line
from hw.clock import MonotonicClock
from hw.dynamixel.codec import (
    BROADCAST,
    ExpectedReply,
    Instruction,
    Parser,
    decode_fast_status,
    encode,
)
from hw.dynamixel.line import Line
from hw.dynamixel.link import Link
from hw.dynamixel.serial_line import FdLine
from hw.dynamixel.together import Together, Way
from hw.servo import Outcome

_ROUNDS, _CYCLES = 15, 60
_COUNTS = (1, 3, 6)
_BAUD: Final = 4_000_000
_START_S: Final = 20.0
_PATIENCE_NS: Final = 50_000_000
_RETURN_DELAY: Final = 9
_GOAL, _GOAL_BYTES = 102, 2
_BLOCK, _BLOCK_BYTES = 126, 10
_DRIVER: Final = "haptic-wall, as its driver reads (16 or 17 bytes)"
_CODEC: Final = "haptic-wall, codec alone"
_OURS: Final = (_DRIVER, _CODEC)

_Cycle = Callable[[], bool]
"""One cycle; whether every servo answered"""


class _Rustypot(Protocol):
    """What is used of a rustypot controller."""

    def set_fast_sync_read(self, enabled: bool, /) -> None: ...

    def read_raw_data(self, id: int, addr: int, length: int, /) -> object: ...  # noqa: A002

    def sync_read_raw_data(self, ids: list[int], addr: int, length: int, /) -> object: ...

    def sync_write_raw_data(self, ids: list[int], addr: int, data: list[list[int]], /) -> None: ...


def measure() -> Section:
    """Time and processor time of a cycle with one servo and with several, of each client."""
    notes: list[str] = []
    rustypot = _rustypot()
    if rustypot is None:
        notes.append(
            "rustypot is not installed, so nothing is compared with it: pip install "
            "'haptic-wall[bench]' adds it, up to Python 3.13"
        )
    rows: list[Row] = []
    for count in _COUNTS:
        ids = range(1, count + 1)
        with _bus(ids) as path, ExitStack() as stack:
            clients = _clients(path, ids, rustypot, stack)
            times, failed = _taking_turns(clients)
        rows += _rows(count, times)
        notes += [
            f"{name}, {count} servos: {cycles} cycles failed and count with their time"
            for name, cycles in failed.items()
            if cycles
        ]
    return Section(tuple(rows), tuple(notes))


def _taking_turns(
    clients: Mapping[str, _Cycle],
) -> tuple[dict[str, tuple[float, float]], dict[str, int]]:
    """Median time and processor time of each client's cycle [µs], and how many cycles failed.

    A round before the first one is not counted. The time is the median of all cycles, because one
    that the machine interrupts takes ten times as long; the processor time that of the rounds.
    """
    now_ns, busy_ns = time.perf_counter_ns, time.thread_time_ns
    taken: dict[str, list[int]] = {name: [] for name in clients}
    worked: dict[str, list[float]] = {name: [] for name in clients}
    failed = dict.fromkeys(clients, 0)
    for counted in range(_ROUNDS + 1):
        for name, cycle in clients.items():
            times = []
            good = 0
            began_ns = busy_ns()
            for _ in range(_CYCLES):
                sent_ns = now_ns()
                good += cycle()
                times.append(now_ns() - sent_ns)
            if counted:
                worked[name].append((busy_ns() - began_ns) / _CYCLES)
                taken[name] += times
                failed[name] += _CYCLES - good
    return {
        name: (1e-3 * statistics.median(taken[name]), 1e-3 * statistics.median(worked[name]))
        for name in clients
    }, failed


def _rows(count: int, times: Mapping[str, tuple[float, float]]) -> list[Row]:
    servos = "1 servo" if count == 1 else f"{count} servos"
    rows = []
    for name, (wall, busy) in times.items():
        rows += [
            Row(
                f"{name}, {servos}",
                wall,
                "µs/cycle",
                "a real adapter, which adds its USB frames and latency timer; in it are the "
                "emulated wire at 4 Mbit/s and the emulator's own time",
            ),
            Row(
                f"{name}, {servos}, processor time",
                busy,
                "µs/cycle",
                "waiting asleep, and what the operating system does in others' name",
            ),
        ]
    peers = [wall for name, (wall, _) in times.items() if name not in _OURS]
    return rows + [
        Row(
            f"the quickest peer's time over that of {name}, {servos}",
            min(peers) / times[name][0],
            "1",
            "equal work: the driver reads the servo's clock too, 6 or 7 bytes more of each servo, "
            "and matches replies to requests"
            if name == _DRIVER
            else "a client: replies are checked, not matched to their requests",
        )
        for name in _OURS
    ]


def _clients(
    path: str, ids: Sequence[int], rustypot: ModuleType | None, stack: ExitStack
) -> dict[str, _Cycle]:
    """Every client with the port open, and its cycle."""
    # A pseudo-terminal is raw already, and only what sets its speed is heard at that speed.
    line = FdLine(os.open(path, os.O_RDWR | os.O_NOCTTY), MonotonicClock())
    stack.callback(line.close)
    line.write(encode(BROADCAST, Instruction.WRITE, struct.pack("<HB", _RETURN_DELAY, 0)))
    alone = len(ids) == 1
    clients = {
        _DRIVER: _link(line, ids[0]) if alone else _together(line, ids),
        _CODEC: _codec(line, ids),
    }
    clients |= _vendors(path, ids, stack)
    if rustypot is not None:  # the last: it keeps others from opening
        client = rustypot.Xl430PyController(path, _BAUD, 1e-9 * _PATIENCE_NS)
        stack.callback(client.close)
        clients |= _rusty(client, ids)
    return clients


def _link(line: Line, id_: int) -> _Cycle:
    link = Link(line, id_)

    def cycle() -> bool:
        link.request()
        sample = link.collect(time.monotonic_ns() + _PATIENCE_NS)
        link.send_current(0)
        return sample.outcome is Outcome.OK

    return cycle


def _together(line: Line, ids: Sequence[int]) -> _Cycle:
    together = Together(line, ids, Way.FAST)
    goals = [0] * len(ids)

    def cycle() -> bool:
        together.request()
        samples = together.collect(time.monotonic_ns() + _PATIENCE_NS)
        together.send_currents(goals)
        return all(sample.outcome is Outcome.OK for sample in samples)

    return cycle


def _codec(line: Line, ids: Sequence[int]) -> _Cycle:
    block = struct.pack("<HH", _BLOCK, _BLOCK_BYTES)
    goals = struct.pack("<HH", _GOAL, _GOAL_BYTES) + b"".join(bytes((i, 0, 0)) for i in ids)
    write = encode(BROADCAST, Instruction.SYNC_WRITE, goals)
    parser = Parser()
    if len(ids) == 1:
        request = encode(ids[0], Instruction.READ, block)
        expected = ExpectedReply(ids[0], _BLOCK_BYTES)
    else:
        request = encode(BROADCAST, Instruction.FAST_SYNC_READ, block + bytes(ids))
        expected = None

    def cycle() -> bool:
        line.write(request)
        deadline_ns = time.monotonic_ns() + _PATIENCE_NS
        good = False
        while not good and line.wait(deadline_ns):
            data = line.read()
            if expected is not None and expected.match(data) is not None:
                good = True
                break
            for frame in parser.feed(data):
                shares = decode_fast_status(frame, _BLOCK_BYTES)
                good = len(shares) == len(ids) or frame.id == ids[0]
        line.write(write)
        return good

    return cycle


def _vendors(path: str, ids: Sequence[int], stack: ExitStack) -> dict[str, _Cycle]:
    sdk = importlib.import_module("dynamixel_sdk")
    port = sdk.PortHandler(path)
    port.baudrate = _BAUD
    port.openPort()
    stack.callback(port.closePort)
    handler = sdk.PacketHandler(2.0)
    write = sdk.GroupSyncWrite(port, handler, _GOAL, _GOAL_BYTES)
    read = sdk.GroupSyncRead(port, handler, _BLOCK, _BLOCK_BYTES)
    for i in ids:
        write.addParam(i, [0, 0])
        read.addParam(i)

    def cycle_of(ask: Callable[[], int]) -> _Cycle:
        def cycle() -> bool:
            good = bool(ask() == sdk.COMM_SUCCESS)
            write.txPacket()
            return good

        return cycle

    name = f"dynamixel-sdk {version('dynamixel-sdk')}"
    if len(ids) == 1:
        return {name: cycle_of(lambda: handler.readTxRx(port, ids[0], _BLOCK, _BLOCK_BYTES)[1])}
    return {
        f"{name}, sync read": cycle_of(read.txRxPacket),
        f"{name}, fast sync read": cycle_of(read.fastSyncRead),
    }


def _rusty(client: _Rustypot, ids: Sequence[int]) -> dict[str, _Cycle]:
    all_ids = list(ids)
    goals = [[0, 0] for _ in ids]

    def cycle_of(ask: Callable[[], object], fast: bool) -> _Cycle:
        def cycle() -> bool:
            client.set_fast_sync_read(fast)
            try:
                ask()
                good = True
            except RuntimeError:
                good = False
            client.sync_write_raw_data(all_ids, _GOAL, goals)
            return good

        return cycle

    def together() -> object:
        return client.sync_read_raw_data(all_ids, _BLOCK, _BLOCK_BYTES)

    name = f"rustypot {version('rustypot')}"
    if len(all_ids) == 1:
        alone = all_ids[0]
        return {name: cycle_of(lambda: client.read_raw_data(alone, _BLOCK, _BLOCK_BYTES), False)}
    return {
        f"{name}, sync read": cycle_of(together, False),
        f"{name}, fast sync read": cycle_of(together, True),
    }


def _rustypot() -> ModuleType | None:
    try:
        return importlib.import_module("rustypot")
    except ImportError:
        return None


@contextmanager
def _bus(ids: Sequence[int]) -> Iterator[str]:
    """An emulated bus in a process of its own, on a core of its own where there are two."""
    cores = os.sched_getaffinity(0)
    apart = {max(cores)} if len(cores) > 1 else cores
    arguments = ["controller.cli.main", "emulate", "--die-with-parent", "--baud", str(_BAUD)]
    for i in ids:
        arguments += ["--servo", f"XM430-W350:{i}"]
    emulator = Child("the emulated bus", arguments, None, cores=apart)
    try:
        path = first_line(emulator, _START_S)
        if path is None:
            raise PlatformError(f"{emulator.name} did not start: it {emulator.exit_text()}")
        os.sched_setaffinity(0, cores - apart or cores)
        yield path
    finally:
        os.sched_setaffinity(0, cores)
        emulator.dismiss(_START_S)
