"""The clients whose bus cycles are compared: this program, dynamixel-sdk and rustypot.

A cycle reads a block of every servo and writes every goal current (2 bytes). The *short* block is
current, velocity and position (10 bytes). The *long* one is the block of this program's driver:
from the servo's clock on, 16 and 17 bytes in turn, which distinguishes a reply from an older one.
"""

from __future__ import annotations

import importlib
import struct
import time
from collections.abc import Callable, Sequence
from contextlib import ExitStack
from importlib.metadata import version
from itertools import cycle as in_turn
from types import ModuleType
from typing import Final, NamedTuple, Protocol

from haptic_wall.hw.dynamixel.codec import (
    BROADCAST,
    ExpectedReplies,
    Instruction,
    SyncWrite,
    encode,
)
from haptic_wall.hw.dynamixel.exchange import Exchange
from haptic_wall.hw.dynamixel.samples import Way
from haptic_wall.hw.serialport.line import Line
from haptic_wall.hw.servo import Outcome

_PATIENCE_NS = 50_000_000
_GOAL, _GOAL_BYTES = 102, 2

Cycle = Callable[[], bool]
"""Executes one cycle; returns whether every servo replied"""


class Block(NamedTuple):
    """Registers that a cycle reads from every servo."""

    name: str
    address: int
    sizes: tuple[int, ...]
    """Numbers of bytes, in turn"""
    layout: str
    """Format of the first bytes for ``struct``"""


SHORT: Final = Block("10 bytes", 126, (10,), "hii")
LONG: Final = Block("16 or 17 bytes", 120, (16, 17), "Hxxhhii")


class _Rustypot(Protocol):
    """The used part of a rustypot controller."""

    def set_fast_sync_read(self, enabled: bool, /) -> None: ...

    def read_raw_data(self, id: int, addr: int, length: int, /) -> object: ...  # noqa: A002

    def sync_read_raw_data(self, ids: list[int], addr: int, length: int, /) -> object: ...

    def sync_write_raw_data(self, ids: list[int], addr: int, data: list[list[int]], /) -> None: ...


def driver(line: Line, ids: Sequence[int]) -> dict[str, Cycle]:
    """Return the cycles of our driver: every reply is matched to its request."""
    exchange = Exchange(line, ids)
    if len(ids) > 1:
        exchange.select(exchange.stations, Way.FAST)
    goals = (0,) * len(ids)

    def cycle() -> bool:
        exchange.request()
        samples = exchange.collect(time.monotonic_ns() + _PATIENCE_NS)
        exchange.send(goals)
        return all(sample.outcome is Outcome.OK for sample in samples)

    return {"haptic-wall, driver": cycle}


def codec(line: Line, ids: Sequence[int], block: Block) -> dict[str, Cycle]:
    """Return the cycles of our codec alone: replies are checked and decoded, not matched."""
    goals = SyncWrite(_GOAL, ids)
    zeros = [0] * len(ids)
    asked = in_turn([_request(ids, block, size) for size in block.sizes])

    def cycle() -> bool:
        request, expected = next(asked)
        line.write(request)
        deadline_ns = time.monotonic_ns() + _PATIENCE_NS
        come = b""
        good = False
        while not good and line.wait(deadline_ns):
            come += line.read()
            found = expected.match(come)
            good = found is not None and not any(error for error, *_ in found)
        line.write(goals.encode(zeros))
        return good

    return {"haptic-wall, codec alone": cycle}


def _request(ids: Sequence[int], block: Block, size: int) -> tuple[bytes, ExpectedReplies]:
    """Return a request, and the pattern of its reply, which also decodes it."""
    params = struct.pack("<HH", block.address, size)
    if len(ids) == 1:
        return encode(ids[0], Instruction.READ, params), ExpectedReplies(ids, size, block.layout)
    request = encode(BROADCAST, Instruction.FAST_SYNC_READ, params + bytes(ids))
    return request, ExpectedReplies(ids, size, block.layout, joint=True)


def vendors(
    path: str, baud: int, ids: Sequence[int], blocks: Sequence[Block], stack: ExitStack
) -> list[dict[str, Cycle]]:
    """Return the cycles of dynamixel-sdk on a port of its own, by block."""
    sdk = importlib.import_module("dynamixel_sdk")
    port = sdk.PortHandler(path)
    port.baudrate = baud
    port.openPort()
    stack.callback(port.closePort)
    handler = sdk.PacketHandler(2.0)
    write = sdk.GroupSyncWrite(port, handler, _GOAL, _GOAL_BYTES)
    for i in ids:
        write.addParam(i, [0, 0])
    name = f"dynamixel-sdk {version('dynamixel-sdk')}"

    def cycle_of(asks: Sequence[Callable[[], int]]) -> Cycle:
        asked = in_turn(asks)

        def cycle() -> bool:
            good = bool(next(asked)() == sdk.COMM_SUCCESS)
            write.txPacket()
            return good

        return cycle

    def alone(address: int, size: int) -> Callable[[], int]:
        return lambda: int(handler.readTxRx(port, ids[0], address, size)[1])

    def of(block: Block) -> dict[str, Cycle]:
        if len(ids) == 1:
            return {name: cycle_of([alone(block.address, size) for size in block.sizes])}
        reads = [sdk.GroupSyncRead(port, handler, block.address, size) for size in block.sizes]
        for read in reads:
            for i in ids:
                read.addParam(i)
        return {
            f"{name}, sync read": cycle_of([read.txRxPacket for read in reads]),
            f"{name}, fast sync read": cycle_of([read.fastSyncRead for read in reads]),
        }

    return [of(block) for block in blocks]


def rusty(
    module: ModuleType,
    path: str,
    baud: int,
    ids: Sequence[int],
    blocks: Sequence[Block],
    stack: ExitStack,
) -> list[dict[str, Cycle]]:
    """Return the cycles of rustypot by block, on a port of its own that it locks."""
    client = module.Xl430PyController(path, baud, 1e-9 * _PATIENCE_NS)
    stack.callback(client.close)
    return [_rusty(client, ids, block) for block in blocks]


def _rusty(client: _Rustypot, ids: Sequence[int], block: Block) -> dict[str, Cycle]:
    all_ids = list(ids)
    goals = [[0, 0] for _ in ids]

    def cycle_of(ask: Callable[[int], object], fast: bool) -> Cycle:
        sizes = in_turn(block.sizes)

        def cycle() -> bool:
            client.set_fast_sync_read(fast)
            try:
                ask(next(sizes))
                good = True
            except RuntimeError:
                good = False
            client.sync_write_raw_data(all_ids, _GOAL, goals)
            return good

        return cycle

    def alone(size: int) -> object:
        return client.read_raw_data(all_ids[0], block.address, size)

    def together(size: int) -> object:
        return client.sync_read_raw_data(all_ids, block.address, size)

    name = f"rustypot {version('rustypot')}"
    if len(all_ids) == 1:
        return {name: cycle_of(alone, False)}
    return {
        f"{name}, sync read": cycle_of(together, False),
        f"{name}, fast sync read": cycle_of(together, True),
    }


def rustypot() -> ModuleType | None:
    """Return the module, or None if it is not installed."""
    try:
        return importlib.import_module("rustypot")
    except ImportError:
        return None
