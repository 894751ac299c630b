"""Clients as they are installed, on the emulated bus's port: dynamixel-sdk and rustypot.

Neither is changed, but for the time they give a reply: a busy machine may need more than 34 ms.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator
from typing import TYPE_CHECKING

import dynamixel_sdk as sdk
import pytest

from haptic_wall.controller.pytest_plugin import DynamixelBus
from haptic_wall.hw.dynamixel.codec import ALERT, ErrorCode

if TYPE_CHECKING:
    from rustypot import Xl330PyController

pytestmark = pytest.mark.realtime

X, SMALL = "XM430-W350", "XL330-M288"
LED, GOAL_CURRENT, GOAL_VELOCITY, GOAL_POSITION, POSITION = 65, 102, 104, 116, 132
ALL = sdk.BROADCAST_ID
PATIENCE_S, SHORT_S = 5.0, 0.1
LIGHT = {"inertia": 5e-4, "damping": 1e-3, "coulomb": 0.005}
three = pytest.mark.dynamixel_bus(servos=[f"{X}:1", f"{X}:2", f"{SMALL}:7"], truth=LIGHT)


class Sdk:
    def __init__(self, bus: DynamixelBus) -> None:
        self.port = sdk.PortHandler(bus.port)
        self.port.baudrate = bus.baud
        assert self.port.openPort()
        self.handler = sdk.PacketHandler(2.0)
        self.patience_s = PATIENCE_S
        self.port.setPacketTimeout = lambda _: self.port.setPacketTimeoutMillis(
            1e3 * self.patience_s
        )


@pytest.fixture
def vendor(dynamixel_bus: DynamixelBus) -> Iterator[Sdk]:
    client = Sdk(dynamixel_bus)
    yield client
    client.port.closePort()


@pytest.fixture
def rusty(dynamixel_bus: DynamixelBus) -> Iterator[Xl330PyController]:
    rustypot = pytest.importorskip("rustypot")
    client = rustypot.Xl330PyController(dynamixel_bus.port, dynamixel_bus.baud, PATIENCE_S)
    yield client
    client.close()


def wait_until(happened: Callable[..., object]) -> None:
    end = time.monotonic() + 30
    while not happened():
        assert time.monotonic() < end


@three
def test_the_vendors_bulk_and_fast_reads_and_writes_of_several_servos(
    vendor: Sdk, dynamixel_bus: DynamixelBus
) -> None:
    write = sdk.GroupSyncWrite(vendor.port, vendor.handler, LED, 1)
    assert write.addParam(1, [1])
    assert write.txPacket() == sdk.COMM_SUCCESS
    done = vendor.handler.write4ByteTxRx(vendor.port, 7, GOAL_POSITION, 3000)
    assert done == (sdk.COMM_SUCCESS, 0)
    for fast in (False, True):
        read = sdk.GroupBulkRead(vendor.port, vendor.handler)
        assert read.addParam(7, GOAL_POSITION, 4)
        assert read.addParam(1, LED, 1)
        assert (read.fastBulkRead() if fast else read.txRxPacket()) == sdk.COMM_SUCCESS
        assert (read.getData(7, GOAL_POSITION, 4), read.getData(1, LED, 1)) == (3000, 1)
        together = sdk.GroupSyncRead(vendor.port, vendor.handler, POSITION, 4)
        for i in (7, 1, 2):
            assert together.addParam(i)
        assert (together.fastSyncRead() if fast else together.txRxPacket()) == sdk.COMM_SUCCESS
        assert [together.getData(i, POSITION, 4) for i in (1, 2, 7)] == [2048] * 3
    assert dynamixel_bus.position(7) == pytest.approx(math.pi)  # torque is off


def test_the_vendor_is_told_each_error_by_its_name(
    vendor: Sdk, dynamixel_bus: DynamixelBus
) -> None:
    port, handler = vendor.port, vendor.handler
    assert handler.write1ByteTxRx(port, 1, 64, 1) == (sdk.COMM_SUCCESS, 0)
    assert handler.write1ByteTxRx(port, 1, 11, 0)[1] == ErrorCode.ACCESS
    assert handler.write1ByteTxRx(port, 1, 64, 0) == (sdk.COMM_SUCCESS, 0)
    assert handler.write1ByteTxRx(port, 1, 11, 2)[1] == ErrorCode.DATA_RANGE
    assert handler.write2ByteTxRx(port, 1, GOAL_CURRENT, 1194)[1] == ErrorCode.DATA_LIMIT
    assert handler.write1ByteTxRx(port, 1, GOAL_CURRENT, 1)[1] == ErrorCode.DATA_LENGTH
    # read4ByteTxRx raises an IndexError here: it takes the CRC of a reply without data for data.
    assert handler.readTxRx(port, 1, 2000, 4)[1:] == (sdk.COMM_SUCCESS, ErrorCode.ACCESS)
    dynamixel_bus.inject("corrupt:way=request,times=1")
    vendor.patience_s = SHORT_S
    _, result, error = handler.ping(port, 1)
    assert (result, error) in ((sdk.COMM_SUCCESS, ErrorCode.CRC), (sdk.COMM_RX_TIMEOUT, 0))
    assert handler.ping(port, 9)[1] == sdk.COMM_RX_TIMEOUT
    vendor.patience_s = PATIENCE_S
    dynamixel_bus.inject("hardware-error:bits=overload")
    assert handler.ping(port, 1) == (1020, sdk.COMM_SUCCESS, ALERT)


@three
def test_rustypot_finds_reads_and_writes(rusty: Xl330PyController) -> None:
    assert rusty.ping(1)
    assert rusty.broadcast_scan() == {1: 1020, 2: 1020, 7: 1200}
    rusty.set_timeout(PATIENCE_S)
    assert [rusty.read_model_number(i)[0] for i in (1, 7)] == [1020, 1200]
    rusty.write_led(7, True)
    assert rusty.read_led(7)[0] == 1
    rusty.write_raw_data(1, GOAL_POSITION, [1, 2, 0, 0])
    assert rusty.read_raw_data(1, GOAL_POSITION, 4) == [1, 2, 0, 0]


@three
def test_rustypot_reads_and_moves_several_servos_at_once(
    rusty: Xl330PyController, dynamixel_bus: DynamixelBus
) -> None:
    ids, goals = [1, 2, 7], [0.4, -0.3, 0.2]
    rusty.sync_write_operating_mode(ids, [3, 3, 3])
    rusty.sync_write_torque_enable(ids, [True] * 3)
    assert [bool(on) for on in rusty.sync_read_torque_enable(ids)] == [True] * 3
    rusty.sync_write_goal_position(ids, goals)
    assert rusty.sync_read_goal_position(ids) == pytest.approx(goals, abs=math.tau / 4096)
    wait_until(lambda: rusty.sync_read_present_position(ids) == pytest.approx(goals, abs=0.02))
    for fast in (True, False):
        rusty.set_fast_sync_read(fast)
        rusty.sync_write_torque_enable(ids, [False] * 3)
        told = rusty.sync_read_present_position(ids)
        blocks = rusty.sync_read_raw_data(ids, 120, 16)
        assert [len(block) for block in blocks] == [16] * 3
        assert told == pytest.approx(goals, abs=0.1)
    told = rusty.sync_read_present_position(ids)
    dynamixel_bus.stop()
    asked = dynamixel_bus.events("rx")[-1].time_s
    for i, angle in zip(ids, told, strict=True):
        after = next(row for row in dynamixel_bus.events("state", i) if row.time_s >= asked)
        # It counts from the middle of the turn, the servo from its start; a millisecond passes.
        near = math.tau / 4096 + 2e-3 * abs(after.velocity_rad_s) + 1e-3
        assert angle + math.pi == pytest.approx(after.position_rad, abs=near)
