"""What the benchmark makes of records and of what loops say; nothing is asserted about speed."""

from pathlib import Path
from typing import NoReturn

import numpy as np
import pytest

from haptic_wall.controller.bench import rates, torque_frames
from haptic_wall.controller.bench.loops import Turn, emulated_bus
from haptic_wall.controller.bench.lost_reply import request_to_torque_s
from haptic_wall.controller.bench.rates import highest_rate_hz
from haptic_wall.controller.bench.report import measured
from haptic_wall.controller.bench.torque_frames import held_up, intervals_us
from haptic_wall.controller.emulated_bus.record import BusRow
from haptic_wall.controller.errors import PlatformError
from haptic_wall.hw.errors import UnfitServoError

READ, SYNC_WRITE = 2, 131


def row(time_s: float, event: str, instruction: int | None = None, fault: str = "") -> BusRow:
    return BusRow(time_s, event, 1, instruction, 0.0, 0.0, 0.0, None, b"", fault)


class TestTorqueFrames:
    def test_frames_that_waited_for_the_bus_together_say_nothing_of_the_loop(self) -> None:
        # 58 bytes take 145 µs at 4 Mbit/s: three frames came behind a stall of 3.4 ms.
        found = np.array([1000.0, 3400.0, 145.0, 146.0, 309.0, 1000.0, 400.0, 1600.0])
        assert held_up(found).tolist() == [*[False], *[True] * 4, *[False] * 3]
        assert held_up(np.array([145.0, 1000.0, 1000.0])).tolist() == [True, True, False]

    def test_a_loop_that_hardly_ran_is_told_in_a_sentence(self) -> None:
        with pytest.raises(PlatformError, match="wanted about 750"):
            intervals_us(10.5 + 1e-3 * np.arange(60.0), 10.0, 11.0, 1.0, 1000.0)
        with pytest.raises(PlatformError, match="found 0 torque frames"):
            intervals_us(np.array([]), 10.0, 11.0, 1.0, 1000.0)

    def test_a_torque_frame_is_a_sync_write_that_has_arrived(self) -> None:
        rows = [row(1.0, "rx", SYNC_WRITE), row(1.1, "rx", READ), row(1.2, "tx", 85)]
        rows += [row(1.3, "state"), row(1.4, "rx", SYNC_WRITE)]
        assert torque_frames.torque_frames(rows).tolist() == [1.0, 1.4]


class TestRates:
    def test_the_highest_rate_is_found_beside_stalls_of_the_machine(self) -> None:
        tried: list[float] = []

        def loop(_path: str, seconds: float, rate_hz: float, _servos: int) -> Turn:
            tried.append(rate_hz)
            if rate_hz > 4000.0:
                raise UnfitServoError("its replies take too long")
            stalled = tried.count(rate_hz) == 1  # the first time at each rate
            return Turn(int(0.02 * seconds * rate_hz) if stalled or rate_hz > 1850 else 0, {})

        assert highest_rate_hz(loop, "") == 1834
        assert len(tried) < 12

    def test_a_loop_that_holds_no_rate_has_the_least(self) -> None:
        assert highest_rate_hz(lambda *_: Turn(10**9, {}), "") == 707


class TestLostReply:
    def test_the_time_runs_from_the_unanswered_request_to_the_next_torque(self) -> None:
        rows = [
            row(1.0, "rx", READ),
            row(1.0001, "tx", 85),
            row(1.0002, "rx", SYNC_WRITE),
            row(1.001, "rx", READ),
            row(1.0011, "fault", 85, "drop"),
            row(1.0011, "tx", 85),
            row(1.0018, "rx", SYNC_WRITE),
            row(1.002, "rx", READ),
            row(1.0022, "rx", SYNC_WRITE),
        ]
        assert request_to_torque_s(rows) == pytest.approx([0.0008])


@pytest.mark.whole
@pytest.mark.realtime
def test_both_loops_run_on_one_bus_and_the_bus_ends_whatever_comes(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(torque_frames, "_ROUNDS", 1)
    monkeypatch.setattr(torque_frames, "_SECONDS", 0.5)
    monkeypatch.setattr(torque_frames, "_RATE_HZ", 500.0)  # a busy machine holds this too
    section = torque_frames.measure()
    values = {each.name: each.value for each in section.rows}
    compared = {name: value for name, value in values.items() if name.endswith("bare loop")}
    assert len(compared) == 4
    for name, value in compared.items():
        ours = name.removesuffix(": over that of the bare loop")
        theirs = ours.replace("haptic-wall", "bare loop")
        assert value == pytest.approx(values[ours] / values[theirs])
    with pytest.raises(KeyboardInterrupt), emulated_bus() as path:
        raise KeyboardInterrupt
    assert not Path(path).exists()


@pytest.mark.whole
@pytest.mark.realtime
def test_both_loops_drive_six_servos_and_find_a_rate(monkeypatch: pytest.MonkeyPatch) -> None:
    for name, value in {
        "_ROUNDS": 1,
        "_SIX_ROUNDS": 1,
        "_SECONDS": 0.3,
        "_SIX_SECONDS": 0.5,
    }.items():
        monkeypatch.setattr(rates, name, value)
    monkeypatch.setattr(rates, "_RATES_HZ", [250, 500])
    rows = rates.measure().rows
    assert [row.unit for row in rows] == ["Hz", "Hz", "1", "µs", "µs", "1", "µs", "µs", "1"]
    assert all(row.value > 0.0 for row in rows)


def test_a_machine_where_the_bus_cannot_start_gets_a_note(monkeypatch: pytest.MonkeyPatch) -> None:
    def none(**_plan: object) -> NoReturn:
        raise PlatformError("the emulated bus did not start: it ended with 4")

    monkeypatch.setattr(torque_frames, "emulated_bus", none)
    report = measured(
        {"torque_frames": "haptic_wall.controller.bench.torque_frames"}, lambda _name: None
    )
    section = report["sections"]["torque_frames"]
    assert section["rows"] == []
    (note,) = section["notes"]
    assert note.startswith("not measured: the emulated bus did not start")
