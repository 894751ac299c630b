"""The record, and that a bus in memory does the same every time."""

import csv
import io

import pytest

from haptic_wall.hw.dynamixel.codec import Instruction
from haptic_wall.hw.dynamixel.codec.frames import Frame
from tests.hw.dynamixel.emulated_client import MS, TORQUE_UNIT, Client


def records(client: Client) -> list[dict[str, str]]:
    client.witness.flush()
    return list(csv.DictReader(io.StringIO(client.record.getvalue())))


def drive(client: Client) -> list[Frame]:
    """A short run with torque both ways; the bytes of all replies."""
    client.enable_current_mode()
    heard = []
    for k in range(40):
        client.sync_write(102, 2, {1: 200 if k < 20 else -300})
        client.send(1, Instruction.READ, bytes([120, 0, 16, 0]))
        heard += client.replies(within_ns=MS // 2)
    return heard


def test_every_frame_and_every_millisecond_is_there_in_order() -> None:
    client = Client()
    start = client.clock.now_ns()
    drive(client)
    rows = records(client)
    times = [float(row["time_s"]) for row in rows]
    assert times == sorted(times)
    states = [float(row["time_s"]) for row in rows if row["event"] == "state"]
    assert states == pytest.approx([0.005 + 0.001 * n for n in range(len(states))], abs=1e-9)
    run = [row for row in rows if float(row["time_s"]) * 1e9 > start]
    kinds = [
        (row["event"], row["id"], row["instruction"]) for row in run if row["event"] != "state"
    ]
    cycle = [("rx", "254", "131"), ("rx", "1", "2"), ("tx", "1", "85")]
    assert kinds[6:] == cycle * 40
    assert all(len(row["time_s"].split(".")[1]) >= 7 for row in rows)


def test_the_state_is_the_truth_behind_the_frame() -> None:
    client = Client()
    client.enable_current_mode()
    client.write(1, 102, 100, 2)
    row = [row for row in records(client) if row["event"] == "rx"][-1]
    assert float(row["torque_nm"]) == pytest.approx(100 * TORQUE_UNIT)
    assert float(row["position_rad"]) == 1.0
    assert row["params"] == "66006400"
    client.pass_time(3 * MS)
    truth = client.servos[1].state(client.clock.now_ns())
    last = [row for row in records(client) if row["event"] == "state"][-1]
    assert 0 < float(last["velocity_rad_s"]) <= truth.velocity


def test_time_passes_only_in_wait_and_never_beyond_the_deadline() -> None:
    client = Client()
    begun = client.clock.now_ns()
    client.send(1, Instruction.PING)
    assert client.line.read() == b""
    assert client.clock.now_ns() == begun
    assert not client.line.wait(begun + 10_000)
    assert client.clock.now_ns() == begun + 10_000
    assert client.line.wait(begun + MS)
    assert client.clock.now_ns() == begun + 60_000
    assert client.line.wait(begun)  # still there
    assert len(client.line.read()) == 14
    assert not client.line.wait(begun)
