"""On made-up records of a run each broken promise is found, and none is invented."""

from pathlib import Path
from typing import Any, cast

import numpy as np
import pytest

from haptic_wall.controller.emulated_bus.record import BusRow
from haptic_wall.hw.dynamixel.codec import Instruction
from scripts.chaos.faults import CORE_HELD, GENTLE, HARD, MAY_END, RECORDER_KILLED
from scripts.chaos.judge import (
    Injected,
    Stall,
    ending,
    explanation,
    gaps,
    growth_mb,
    missing_at_end,
    stalled,
)
from scripts.chaos.page import WATCHED, Hour, lines
from scripts.chaos.run import ASKED, DID_NOT_START, Course, Run
from scripts.chaos.verdict import growth, judge
from scripts.studies import chaos

WATCHDOG_S = 0.04
GOAL, ON, OFF = "6600020001", "400001", "400000"


def state(time_s: float, torque: float) -> BusRow:
    return BusRow(time_s, "state", 1, None, 0.0, 0.0, torque, None, b"", "")


def frame(
    time_s: float, torque: float, instruction: Instruction, params: str, error: int = 0
) -> BusRow:
    return BusRow(time_s, "rx", 1, instruction, 0.0, 0.0, torque, error, bytes.fromhex(params), "")


def goal(time_s: float, current: int) -> BusRow:
    data = current.to_bytes(2, "little", signed=True).hex()
    return frame(time_s, 0.01 * current, Instruction.SYNC_WRITE, GOAL + data)


def pressing(until_s: float) -> list[BusRow]:
    """A record of a wall that presses at 1 kHz until then, torque enabled at 0."""
    rows = [frame(0.0, 0.0, Instruction.WRITE, ON)]
    for tick in range(round(until_s * 1000)):
        rows += [goal(tick * 1e-3 + 1e-4, -50), state(tick * 1e-3 + 5e-4, -0.5)]
    return rows


def ended(cut_s: float) -> list[BusRow]:
    """The same, cut in time."""
    return [
        *pressing(cut_s),
        goal(cut_s, 0),
        frame(cut_s + 2e-4, 0.0, Instruction.WRITE, OFF),
        *(state(cut_s + 1e-3 * n, 0.0) for n in range(1, 200)),
    ]


def test_a_run_that_was_cut_in_time_has_no_offence() -> None:
    found = ending(ended(0.5), WATCHDOG_S)
    assert found.offences == []
    assert found.cut_s == pytest.approx(0.5002)
    assert found.torque_until_s == pytest.approx(0.4995)
    assert found.goals == 501


@pytest.mark.parametrize(
    ("late", "offence"),
    [
        (state(0.55, -0.5), "-0.5 N·m 49.8 ms after the cut"),
        (goal(0.55, -50), "a goal of -50 was sent after the cut"),
        (frame(0.55, 0.0, Instruction.WRITE, ON), "torque was switched on again after the cut"),
    ],
)
def test_torque_after_a_trip_is_found(late: BusRow, offence: str) -> None:
    assert ending([*ended(0.5), late], WATCHDOG_S).offences == [offence]


def test_a_torque_off_that_was_damaged_on_its_way_is_no_cut() -> None:
    rows = [*pressing(0.5), frame(0.5, -0.5, Instruction.WRITE, OFF, error=3), state(0.51, -0.5)]
    assert ending(rows, WATCHDOG_S).cut_s is None


def test_behind_an_end_that_nobody_witnessed_the_bus_watchdog_is_the_cut() -> None:
    alone = pressing(0.5)
    inside = [*alone, state(0.499 + WATCHDOG_S, -0.5), state(0.6, 0.0)]
    assert ending(inside, WATCHDOG_S).offences == []
    (offence,) = ending([*alone, state(0.65, -0.5)], WATCHDOG_S).offences
    assert "after the Bus Watchdog should have ended it" in offence


@pytest.mark.parametrize(
    ("torque_s", "offence"),
    [
        (0.5 + WATCHDOG_S, []),
        (0.58, ["torque 40.9 ms after the Bus Watchdog should have ended it"]),
    ],
)
def test_before_a_cut_that_comes_late_the_bus_watchdog_must_have_ended_the_torque(
    torque_s: float, offence: list[str]
) -> None:
    rows = [
        *pressing(0.5),
        state(torque_s, -0.5),
        frame(0.62, 0.0, Instruction.WRITE, OFF),
        state(0.63, 0.0),
    ]
    found = ending(rows, WATCHDOG_S)
    assert found.cut_s == 0.62
    assert found.offences == offence


def test_a_goal_that_acts_after_the_bus_watchdog_should_have_tripped_is_found() -> None:
    off = frame(0.61, 0.0, Instruction.WRITE, OFF)
    rows = [*pressing(0.5), state(0.55, 0.0), goal(0.6, -50), off]
    (offence,) = ending(rows, WATCHDOG_S).offences
    assert offence == "torque 60.9 ms after the Bus Watchdog should have ended it"


def test_a_bus_watchdog_that_tripped_at_no_torque_may_be_armed_again() -> None:
    again = [goal(0.6 + n * 1e-3, -50) for n in range(20)]
    rows = [*pressing(0.5), goal(0.5, 0), goal(0.599, 0), *again]
    assert ending([*rows, frame(0.62, 0.0, Instruction.WRITE, OFF)], WATCHDOG_S).offences == []


def test_the_start_up_may_switch_torque_on_and_off() -> None:
    probe = [
        frame(0.0, 0.0, Instruction.WRITE, OFF),
        frame(0.1, 0.0, Instruction.WRITE, ON),
        goal(0.2, 10),
        frame(0.3, 0.0, Instruction.WRITE, OFF),
        frame(0.4, 0.0, Instruction.WRITE, ON),
    ]
    assert ending([*probe, *ended(0.5)], WATCHDOG_S).offences == []


FAULTS = [
    Injected("recorder killed", 5.0, 5.0),
    Injected("loop stopped for 0.1 to 1 s", 10.0, 10.4),
    Injected("encoder jumps", 30.0, 30.5),
]


@pytest.mark.parametrize(
    ("reason", "stopped_s", "cause"),
    [
        ("trip:loop_hung", 10.1, "loop stopped for 0.1 to 1 s"),
        ("trip:overspeed", 30.01, "encoder jumps"),
        ("trip:overspeed", 29.0, None),  # before the fault
        ("trip:loop_hung", 20.0, None),  # long after
        ("trip:loop_died", 10.1, None),  # not what this fault may cause
        ("trip:loop_died", 5.1, None),  # nothing may come of a killed recorder
        ("interrupted", 10.1, None),  # nobody asked
    ],
)
def test_only_a_shot_shortly_before_that_may_cause_it_explains_an_end(
    reason: str, stopped_s: float, cause: str | None
) -> None:
    assert explanation(reason, stopped_s, FAULTS, MAY_END) == cause


def test_a_stall_explains_only_what_stalls_cause_and_only_where_it_was_long_enough() -> None:
    stalls = [Stall(10.0, 10.03)]
    assert stalled("trip:torque_lost", 10.05, stalls, 0.02)
    assert not stalled("trip:torque_lost", 10.05, stalls, 0.04)
    assert not stalled("trip:torque_lost", 15.0, stalls, 0.02)
    assert not stalled("trip:overspeed", 10.05, stalls, 0.02)


def test_gaps_in_a_log_are_found() -> None:
    whole = np.arange(1000)
    assert gaps(whole) == []
    assert gaps(whole[3:]) == [(0, 3)]
    assert gaps(np.delete(whole, slice(500, 750))) == [(500, 250)]
    assert gaps(np.concatenate([whole[:600], whole[500:]])) == [(600, -100)]


def test_ticks_behind_the_last_row_are_found_but_for_the_frames_of_the_stop() -> None:
    goals = [tick * 1e-3 + 1e-4 for tick in range(1000)]
    assert missing_at_end(goals, 0.999) == 0
    assert missing_at_end(goals, 0.990) == 0
    assert missing_at_end(goals, 0.749) == 151 - 8


def test_growth_is_found_and_what_settles_is_not() -> None:
    minutes = np.arange(0.0, 600.0, 2.0)
    settling = [(t, 60.0 + 10.0 * min(t, 80.0) / 80.0) for t in minutes]
    assert growth_mb(settling) == 0.0
    leaking = [(t, 60.0 + 6.0 * max(0.0, t - 90.0) / 390.0) for t in minutes]
    assert growth_mb(leaking) == pytest.approx(6.0, abs=1.5)
    assert growth_mb([(t, 60.0 + 20.0 * (t > 300.0)) for t in minutes]) == 20.0
    assert growth_mb(settling[:60]) is None


def test_a_recorder_that_was_replaced_is_another_process() -> None:
    """Each in its first minute is as large as the next, and what lives through it has grown."""
    run = Run()
    run.memory = {
        ("recorder", n): [(t, 60.0 + t / 10.0) for t in range(0, 40, 2)] for n in range(20)
    }
    assert growth(run) == {}
    run.memory["recorder", 99] = [(t, 60.0 + 6.0 * (t > 300)) for t in range(0, 600, 2)]
    run.memory["recorder", 100] = [(t, 60.0) for t in range(0, 600, 2)]
    assert growth(run) == {"recorder": 6.0}


def test_in_the_run_that_watches_the_recorder_none_is_killed() -> None:
    assert RECORDER_KILLED in [fault.name for fault in GENTLE]
    spared = [fault.name for fault in chaos.sparing_recorder(iter(GENTLE))]
    assert spared == [fault.name for fault in GENTLE if fault.name != RECORDER_KILLED]


def text_of(hour: Hour) -> str:
    return "\n".join(lines(hour))


def a_run(reason: str = "interrupted", cause: str | None = ASKED, **more: Any) -> Run:
    return Run(reason=reason, cause=cause, injected=[Injected(ASKED, 9.0, 9.5)], **more)


@pytest.mark.parametrize(
    ("run", "words"),
    [
        (a_run("trip:overspeed", None), "ended by trip:overspeed, which nothing explains"),
        (a_run(torque_problems=["0.5 N·m late"]), "0.5 N·m late"),
        (a_run(log_problems=["3 rows are missing at 5"]), "3 rows are missing at 5"),
        (a_run(other_problems=["the loop outlived the run"]), "the loop outlived the run"),
        (a_run("trip:loop_died", "loop killed", off_s=0.07), "70 ms from a fault at the loop"),
        (a_run("trip:loop_hung", CORE_HELD, off_s=0.07), "70 ms from a fault at the loop"),
        (
            a_run(memory={("loop", 7): [(t, 60.0 + (t > 300)) for t in range(0, 600, 2)]}),
            "",
        ),
        (
            a_run(memory={("loop", 7): [(t, 60.0 + 6 * (t > 300)) for t in range(0, 600, 2)]}),
            "the loop grew by 6.0 MB",
        ),
    ],
)
def test_the_page_says_each_promise_that_did_not_hold(run: Run, words: str) -> None:
    hour = Hour(60.0, 1, [a_run(), run], whole=True)
    text = text_of(hour)
    assert ("Did not hold" in text) == bool(words)
    assert words in text
    assert ("**no**" in text) == bool(words)


def test_memory_is_only_called_flat_where_every_process_was_watched() -> None:
    flat = [(float(t), 60.0) for t in range(0, 600, 2)]
    run = a_run(memory={(name, n): flat for n, name in enumerate(WATCHED) if name != "recorder"})
    assert "no recorder was watched long enough, supervisor +0.0 MB | – |" in text_of(
        Hour(60.0, 1, [run])
    )
    run.memory["recorder", 99] = flat
    assert "recorder +0.0 MB, supervisor +0.0 MB | yes |" in text_of(Hour(60.0, 1, [run]))


def test_a_page_of_an_hour_that_was_broken_off_says_so() -> None:
    assert "broken off" in text_of(Hour(60.0, 1, [a_run()]))
    assert "broken off" not in text_of(Hour(60.0, 1, [a_run()], whole=True))


def test_a_start_that_was_refused_is_told_apart_from_a_run_that_ended(tmp_path: Path) -> None:
    said = f"{DID_NOT_START}: haptic-wall: The servo must not be driven as it is."
    run = Run(reason=said)
    (tmp_path / "witness.csv").touch()
    judge(run, cast(Course, None), tmp_path, None, (), ())
    text = text_of(Hour(60.0, 1, [a_run(), run], whole=True))
    assert "1 refused to start" in text
    assert "must not be driven as it is" in text
    assert "**no**" not in text
    assert not Run(reason=f"{DID_NOT_START}: it said nothing").refused
    assert not Run(reason=said, began_s=9.0).refused


def test_a_gentle_shot_explains_nothing_and_a_hard_one_something() -> None:
    assert all(not fault.may_end for fault in GENTLE)
    assert all(fault.may_end for fault in HARD)
    assert len(MAY_END) == len(GENTLE) + len(HARD)
