"""The vendor's own client on the emulated bus: an independent reading of the protocol."""

import math
from dataclasses import replace
from typing import Any

import dynamixel_sdk as sdk
import pytest

from tests.hw.dynamixel.emulated_client import BAUD, FREE, MS, Client
from tests.hw.emulated.sdk_port import LinePort

X, SMALL = "XM430-W350", "XL330-M288"
LED, TORQUE_ENABLE, GOAL_CURRENT, GOAL_POSITION, POSITION, VOLTAGE = 65, 64, 102, 116, 132, 144
COUNTS = round(FREE.position * 4096 / (2 * math.pi))


class Sdk:
    """Its packet handler and a port on the simulated clock."""

    def __init__(self, *servos: tuple[str, int], **kwargs: Any) -> None:
        self.client = Client(*servos, **kwargs)
        self.port = LinePort(self.client.line, BAUD)
        self.handler = sdk.Protocol2PacketHandler()


def test_ping_of_one_and_of_all() -> None:
    bench = Sdk((X, 1), (SMALL, 7))
    assert bench.handler.ping(bench.port, 1) == (1020, sdk.COMM_SUCCESS, 0)
    assert bench.handler.ping(bench.port, 7) == (1200, sdk.COMM_SUCCESS, 0)
    assert bench.handler.ping(bench.port, 3)[1] == sdk.COMM_RX_TIMEOUT
    found, result = bench.handler.broadcastPing(bench.port)
    assert (found, result) == ({1: [1020, 48], 7: [1200, 48]}, sdk.COMM_SUCCESS)


def test_bulk_read_and_write_of_different_registers() -> None:
    bench = Sdk((X, 1), (SMALL, 7))
    write = sdk.GroupBulkWrite(bench.port, bench.handler)
    assert write.addParam(1, LED, 1, [1])
    assert write.addParam(7, GOAL_POSITION, 4, list((3000).to_bytes(4, "little")))
    assert write.txPacket() == sdk.COMM_SUCCESS
    read = sdk.GroupBulkRead(bench.port, bench.handler)
    assert read.addParam(7, GOAL_POSITION, 4)
    assert read.addParam(1, LED, 1)
    assert read.txRxPacket() == sdk.COMM_SUCCESS
    assert read.getData(7, GOAL_POSITION, 4) == 3000
    assert read.getData(1, LED, 1) == 1


def test_fast_bulk_read() -> None:
    bench = Sdk((X, 1), (SMALL, 7), (X, 3))
    read = sdk.GroupBulkRead(bench.port, bench.handler)
    read.addParam(7, POSITION, 4)
    read.addParam(1, VOLTAGE, 2)
    read.addParam(3, LED, 1)
    assert read.fastBulkRead() == sdk.COMM_SUCCESS
    assert read.getData(7, POSITION, 4) == COUNTS
    assert read.getData(1, VOLTAGE, 2) == 120
    assert read.getData(3, LED, 1) == 0


def test_fast_sync_read_and_sync_read_say_the_same() -> None:
    bench = Sdk(*((X, i) for i in (1, 2, 3)))
    read = sdk.GroupSyncRead(bench.port, bench.handler, POSITION, 4)
    for i in (3, 1, 2):
        read.addParam(i)
    assert read.fastSyncRead() == sdk.COMM_SUCCESS
    fast = [read.getData(i, POSITION, 4) for i in (1, 2, 3)]
    assert read.txRxPacket() == sdk.COMM_SUCCESS
    assert fast == [read.getData(i, POSITION, 4) for i in (1, 2, 3)] == [COUNTS] * 3


@pytest.mark.parametrize("way", ["fastSyncRead", "fastBulkRead"])
@pytest.mark.parametrize("missing", ["absent", "old"])
def test_a_fast_read_fails_as_a_whole_where_one_servo_cannot(way: str, missing: str) -> None:
    bench = Sdk((X, 1), (X, 2), firmware=44 if missing == "old" else 48)
    read = (
        sdk.GroupSyncRead(bench.port, bench.handler, POSITION, 4)
        if way == "fastSyncRead"
        else sdk.GroupBulkRead(bench.port, bench.handler)
    )
    for i in (1, 2) if missing == "old" else (1, 9, 2):
        assert read.addParam(i) if way == "fastSyncRead" else read.addParam(i, POSITION, 4)
    assert getattr(read, way)() in (sdk.COMM_RX_TIMEOUT, sdk.COMM_RX_CORRUPT)
    bench.client.pass_time(5 * MS)
    assert bench.handler.ping(bench.port, 1)[1] == sdk.COMM_SUCCESS


def test_reg_write_and_action() -> None:
    bench = Sdk((X, 1), (X, 2))
    for i in (1, 2):
        assert bench.handler.regWriteTxRx(bench.port, i, LED, 1, [1]) == (sdk.COMM_SUCCESS, 0)
    assert bench.handler.read1ByteTxRx(bench.port, 2, LED)[0] == 0
    bench.handler.action(bench.port, sdk.BROADCAST_ID)
    bench.client.pass_time(MS)
    assert [bench.handler.read1ByteTxRx(bench.port, i, LED)[0] for i in (1, 2)] == [1, 1]


def test_factory_reset() -> None:
    bench = Sdk((X, 5))
    port, handler = bench.port, bench.handler
    assert handler.write4ByteTxRx(port, 5, 20, 1000) == (sdk.COMM_SUCCESS, 0)
    assert handler.factoryReset(port, 5, 0x02) == (sdk.COMM_SUCCESS, 0)
    bench.client.pass_time(500 * MS)
    assert handler.read4ByteTxRx(port, 5, 20) == (0, sdk.COMM_SUCCESS, 0)


def test_reboot_and_clear() -> None:
    bench = Sdk((X, 1), true=replace(FREE, position=2.5 * 2 * math.pi))
    port, handler = bench.port, bench.handler
    assert handler.read4ByteTxRx(port, 1, POSITION)[0] == 2.5 * 4096
    assert handler.clearMultiTurn(port, 1) == (sdk.COMM_SUCCESS, 0)
    assert handler.read4ByteTxRx(port, 1, POSITION)[0] == 2048
    assert handler.write1ByteTxRx(port, 1, TORQUE_ENABLE, 1) == (sdk.COMM_SUCCESS, 0)
    assert handler.reboot(port, 1) == (sdk.COMM_SUCCESS, 0)
    assert handler.ping(port, 1)[1] == sdk.COMM_RX_TIMEOUT
    bench.client.pass_time(500 * MS)
    assert handler.read1ByteTxRx(port, 1, TORQUE_ENABLE)[0] == 0


def test_the_header_it_does_not_stuff_arrives() -> None:
    """Goal current -1 and a goal velocity of 0x..00FD: FF FF FD 00, sent as it is."""
    bench = Sdk((X, 1))
    data = [0xFF, 0xFF, 0xFD, 0x00, 0x00, 0x00]
    assert bench.handler.write4ByteTxRx(bench.port, 1, 44, 300) == (sdk.COMM_SUCCESS, 0)
    assert bench.handler.writeTxRx(bench.port, 1, GOAL_CURRENT, 6, data) == (sdk.COMM_SUCCESS, 0)
    servo = bench.client.servos[1]
    assert (servo.memory["goal_current"], servo.memory["goal_velocity"]) == (-1, 253)


def test_indirect_addresses_with_a_sync_read_of_its_group() -> None:
    bench = Sdk((X, 1), (X, 2))
    for i in (1, 2):
        for n, address in enumerate((LED, *range(POSITION, POSITION + 4))):
            done = bench.handler.write2ByteTxRx(bench.port, i, 168 + 2 * n, address)
            assert done == (sdk.COMM_SUCCESS, 0)
    bench.handler.write1ByteTxRx(bench.port, 2, LED, 1)
    read = sdk.GroupSyncRead(bench.port, bench.handler, 224, 5)
    read.addParam(1)
    read.addParam(2)
    assert read.txRxPacket() == sdk.COMM_SUCCESS
    assert [read.getData(i, 224, 1) for i in (1, 2)] == [0, 1]
    assert [read.getData(i, 225, 4) for i in (1, 2)] == [COUNTS, COUNTS]
