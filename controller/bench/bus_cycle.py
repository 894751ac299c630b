"""Measures the cost of a bus cycle: this program beside dynamixel-sdk and rustypot, on one port.

All clients have the same emulated bus open and take short turns, so that the machine's other work
affects them alike. Clients are compared that do the same work: they read the same bytes, in the
same rounds.
"""

from __future__ import annotations

import os
import statistics
import struct
import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field
from types import ModuleType
from typing import Final

from haptic_wall.controller.bench.bus_clients import (
    LONG,
    SHORT,
    Cycle,
    codec,
    driver,
    rusty,
    rustypot,
    vendors,
)
from haptic_wall.controller.bench.loops import BAUD, emulated_bus
from haptic_wall.controller.bench.rows import Measurement, Section, ratio
from haptic_wall.hw.clock import MonotonicClock
from haptic_wall.hw.dynamixel.codec import BROADCAST, Instruction, encode
from haptic_wall.hw.serialport.line import FdLine

_ROUNDS, _CYCLES = 40, 24
_COUNTS = (1, 3, 6)
_BLOCKS: Final = (SHORT, LONG)
_RETURN_DELAY: Final = 9
_OURS: Final = "haptic-wall"


@dataclass(slots=True)
class _Times:
    """Times of one client [µs]."""

    rounds: list[float] = field(default_factory=list)
    """Median cycle of each round"""
    busy: list[float] = field(default_factory=list)
    """Median processor time per cycle of each round"""
    cycles: list[float] = field(default_factory=list)
    """Every cycle, for the picture"""
    failed: int = 0


def measure() -> Section:
    """Measure time and processor time of a cycle with one servo and several, for each client."""
    notes: list[str] = []
    compiled = rustypot()
    if compiled is None:
        notes.append(
            "rustypot is not installed, so nothing is compared with it: pip install "
            "-e '.[bench]' in the clone adds it, up to Python 3.13"
        )
    rows: list[Measurement] = []
    for count in _COUNTS:
        ids = range(1, count + 1)
        with _bus(ids) as path, ExitStack() as stack:
            groups = _clients(path, ids, compiled, stack)
            times = _taking_turns(groups)
        for title, clients in times.items():
            what = f"{title}, {count} servos" if count > 1 else f"{title}, 1 servo"
            rows += _rows(what, clients)
            notes += [
                f"{name}, {what}: {client.failed} of {_ROUNDS * _CYCLES} cycles failed and count"
                " with their time"
                for name, client in clients.items()
                if client.failed
            ]
    return Section(tuple(rows), tuple(notes))


def _taking_turns(
    groups: Mapping[str, Mapping[str, Cycle]],
) -> dict[str, dict[str, _Times]]:
    """Return every client's times, by block and client; the first round is not counted.

    It uses medians, because a cycle that the machine interrupts takes ten times as long.
    """
    now_ns, busy_ns = time.perf_counter_ns, time.thread_time_ns
    times = {title: {name: _Times() for name in clients} for title, clients in groups.items()}
    for counted in range(_ROUNDS + 1):
        for title, clients in groups.items():
            for name, cycle in clients.items():
                taken, worked = [], []
                good = 0
                for _ in range(_CYCLES):
                    began_ns = busy_ns()
                    sent_ns = now_ns()
                    good += cycle()
                    taken.append(now_ns() - sent_ns)
                    worked.append(busy_ns() - began_ns)
                if counted:
                    client = times[title][name]
                    client.busy.append(1e-3 * statistics.median(worked))
                    client.cycles += [1e-3 * each for each in taken]
                    client.rounds.append(1e-3 * statistics.median(taken))
                    client.failed += _CYCLES - good
    return times


def _rows(what: str, clients: Mapping[str, _Times]) -> list[Measurement]:
    rows = []
    for name, times in clients.items():
        rows += [
            Measurement(
                f"{name}, {what}",
                statistics.median(times.rounds),
                "µs/cycle",
                "a real adapter, which adds its USB frames and latency timer; the time includes "
                "the emulated wire at 4 Mbit/s, the emulator, and a kernel thread that carries the "
                "bytes of a pseudo-terminal and may wait for a client that spins",
            ),
            Measurement(
                f"{name}, {what}, processor time",
                statistics.median(times.busy),
                "µs/cycle",
                "time asleep, and time of the operating system on behalf of other processes",
            ),
        ]
    peers = {name: times for name, times in clients.items() if not name.startswith(_OURS)}
    quickest = min(peers, key=lambda name: statistics.median(peers[name].rounds))
    for name, times in clients.items():
        if name.startswith(_OURS):
            rows.append(
                ratio(
                    f"{name}, {what}: time over that of {quickest}",
                    times.rounds,
                    peers[quickest].rounds,
                    "different work: both read the same bytes",
                )
            )
    return rows


def _clients(
    path: str, ids: Sequence[int], compiled: ModuleType | None, stack: ExitStack
) -> dict[str, dict[str, Cycle]]:
    """Return the cycles of every client with the port open, by block."""
    # A pseudo-terminal is raw already; it only needs the baud rate.
    line = FdLine(os.open(path, os.O_RDWR | os.O_NOCTTY), MonotonicClock())
    stack.callback(line.close)
    line.write(encode(BROADCAST, Instruction.WRITE, struct.pack("<HB", _RETURN_DELAY, 0)))
    peers = [vendors(path, BAUD, ids, _BLOCKS, stack)]
    if compiled is not None:  # the last: it locks the port
        peers.append(rusty(compiled, path, BAUD, ids, _BLOCKS, stack))
    groups = {}
    for block, *theirs in zip(_BLOCKS, *peers, strict=True):
        groups[block.name] = driver(line, ids) if block is LONG else {}
        for cycles in (codec(line, ids, block), *theirs):
            groups[block.name] |= cycles
    return groups


@contextmanager
def _bus(ids: Sequence[int]) -> Iterator[str]:
    """Start an emulated bus; with two cores the clients have one of their own."""
    cores = os.sched_getaffinity(0)
    apart = {max(cores)} if len(cores) > 1 else cores
    with emulated_bus(ids=ids, cores=apart) as path:
        try:
            os.sched_setaffinity(0, {min(cores - apart or cores)})
            yield path
        finally:
            os.sched_setaffinity(0, cores)
