"""The fixture used as others use it, in this suite: marker, faults, record, mistakes."""

from __future__ import annotations

import os
import threading
import time
from pathlib import Path

import dynamixel_sdk as sdk
import pytest

from haptic_wall.controller.pytest_plugin import BusError, BusRow, DynamixelBus
from tests.support.program import wait_for

pytestmark = pytest.mark.realtime

PATIENCE_MS, SHORT_MS = 10_000, 50


class Client:
    def __init__(self, bus: DynamixelBus) -> None:
        self.port = sdk.PortHandler(bus.port)
        self.port.baudrate = bus.baud
        assert self.port.openPort()
        self.handler = sdk.PacketHandler(2.0)

    def __enter__(self) -> Client:
        return self

    def __exit__(self, *_: object) -> None:
        self.port.closePort()

    def ping(self, id_: int = 1, patience_ms: int = PATIENCE_MS) -> tuple[int, int, int]:
        self.port.setPacketTimeout = lambda _: self.port.setPacketTimeoutMillis(patience_ms)
        answer: tuple[int, int, int] = self.handler.ping(self.port, id_)
        return answer


def test_a_bus_by_default(dynamixel_bus: DynamixelBus) -> None:
    assert (dynamixel_bus.ids, dynamixel_bus.baud) == ((1,), 4_000_000)
    with Client(dynamixel_bus) as client:
        assert client.ping() == (1020, 0, 0)


@pytest.mark.dynamixel_bus(servos=["XL330-M288:3", "XM430-W350"], baud=1_000_000)
class TestMarkers:
    @pytest.mark.dynamixel_bus(truth={"position": 1.0}, latency_timer=2, block=62)
    def test_what_is_nearer_to_the_test_adds_to_the_rest(self, dynamixel_bus: DynamixelBus) -> None:
        assert (dynamixel_bus.ids, dynamixel_bus.baud) == ((3, 1), 1_000_000)
        assert dynamixel_bus.position(3) == pytest.approx(1.0)
        with Client(dynamixel_bus) as client:
            assert client.ping(3) == (1200, 0, 0)
            assert client.ping(1) == (1020, 0, 0)

    @pytest.mark.dynamixel_bus(baud=57_600)
    def test_and_outdoes_it(self, dynamixel_bus: DynamixelBus) -> None:
        assert (dynamixel_bus.ids, dynamixel_bus.baud) == ((3, 1), 57_600)


@pytest.mark.dynamixel_bus(faults=["drop:way=reply"])
def test_faults_come_and_go(dynamixel_bus: DynamixelBus) -> None:
    with Client(dynamixel_bus) as client:
        assert client.ping(patience_ms=SHORT_MS)[1] == sdk.COMM_RX_TIMEOUT
        dynamixel_bus.lift("drop")
        assert client.ping() == (1020, 0, 0)
        dynamixel_bus.inject("hardware-error:bits=overload")
        dynamixel_bus.lift("hardware-error")
        assert client.ping() == (1020, 0, 128)
    assert [row.fault for row in dynamixel_bus.events("fault", 1)] == ["drop", "hardware-error"]


def test_the_record_holds_what_happened_also_after_the_end() -> None:
    with DynamixelBus(["XM430-W350:5"], truth={"position": 2.0}) as bus, Client(bus) as client:
        begun = time.monotonic()
        client.port.setPacketTimeout = lambda _: client.port.setPacketTimeoutMillis(PATIENCE_MS)
        client.handler.read4ByteTxRx(client.port, 5, 132)
        now = bus.rows
        ended = time.monotonic()
    (asked,) = [row for row in now if row.event == "rx"]
    (told,) = [row for row in now if row.event == "tx"]
    assert begun < asked.time_s < told.time_s < ended
    assert (asked.id, asked.instruction, asked.params) == (5, 2, bytes([132, 0, 4, 0]))
    assert (told.instruction, told.error) == (85, 0)
    assert int.from_bytes(told.params, "little") == 1304  # 2 rad in counts of 1/4096 turn, rounded
    assert asked.position_rad == 2.0
    assert bus.rows[: len(now)] == now
    assert bus.state(5).event == "state"
    assert all(isinstance(row, BusRow) for row in bus.rows)
    bus.stop()


def test_the_port_stays_when_the_adapter_is_unplugged_and_back(dynamixel_bus: DynamixelBus) -> None:
    link = Path(dynamixel_bus.port)
    held = os.open(link, os.O_RDWR | os.O_NOCTTY)
    before = link.resolve()
    dynamixel_bus.inject("unplug-adapter:for=0.1")
    # First it is still the old terminal, then there is none, then it is a new one.
    neither = (before, link.parent.resolve() / link.name)
    wait_for(lambda: link.resolve() not in neither, "a new terminal", 20.0)
    os.close(held)
    with Client(dynamixel_bus) as client:
        assert client.ping() == (1020, 0, 0)
    dynamixel_bus.inject("drop")  # what it says of this is told apart from the new path


def test_mistakes_while_it_runs_are_told_and_do_not_end_it(dynamixel_bus: DynamixelBus) -> None:
    with pytest.raises(BusError, match="drop"):
        dynamixel_bus.inject("dorp")
    with pytest.raises(BusError, match="has the id 9"):
        dynamixel_bus.inject("stuck:id=9")
    with pytest.raises(BusError, match="no fault"):
        dynamixel_bus.lift("dorp")
    with pytest.raises(BusError, match="No servo has the id 9"):
        dynamixel_bus.position(9)
    dynamixel_bus.inject("drop")
    dynamixel_bus.stop()
    with pytest.raises(BusError, match="does not run"):
        dynamixel_bus.inject("drop")


def test_the_bus_outlives_the_thread_that_started_it() -> None:
    """A fixture may be set up in a thread of its own."""
    bus = DynamixelBus()
    thread = threading.Thread(target=bus.__enter__)
    thread.start()
    thread.join()
    try:
        with Client(bus) as client:
            assert client.ping() == (1020, 0, 0)
        assert bus.rows[-1].time_s > 0.0
    finally:
        bus.stop()
