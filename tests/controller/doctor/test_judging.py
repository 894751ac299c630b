"""What measurements mean: which schedule suits, which rate holds, what the machine grants."""

from collections.abc import Sequence
from typing import Literal

import pytest

from haptic_wall.controller.doctor.replies import Replies
from haptic_wall.controller.doctor.timing import (
    judge_lateness,
    judge_replies,
    judge_rights,
    sustainable_hz,
)
from haptic_wall.hw.servo import Check
from haptic_wall.hw.settings import Schedule

MS = 1_000_000


def replies(
    took_ns: Sequence[int],
    in_row_ns: int,
    lost: int = 0,
    corrupt: int = 0,
) -> Replies:
    return Replies(list(took_ns), in_row_ns, len(took_ns) + lost + corrupt, lost, corrupt)


def held(timer_ns: int) -> Replies:
    """Replies ready in 0.1 ms, asked for at all phases of 1 ms after the timer has run out."""
    took = sorted(timer_ns - k * MS // 200 + MS // 10 for k in range(200))
    return replies(took, timer_ns)


QUICK = replies([MS // 10] * 200, MS // 10)
TIMER = held(MS)
FACTORY = held(16 * MS)


def judged(found: Replies, schedule: Schedule | Literal["auto"] = "immediate") -> dict[str, Check]:
    return {each.name: each for each in judge_replies(found, schedule, 1000.0, 4_000_000)}


def test_quick_replies_are_well_in_both_schedules() -> None:
    found = judged(QUICK, "immediate")
    assert all(finding.ok and not finding.fix for finding in found.values())
    found = judged(QUICK, "pipelined")
    assert all(finding.ok for finding in found.values())
    assert found["sustainable rate"].fix == "set servo.schedule=immediate"  # younger samples


def test_a_timer_of_1_ms_is_too_slow_for_immediate_and_pipelined_is_named() -> None:
    found = judged(TIMER)
    wrong = {name for name, finding in found.items() if not finding.ok}
    assert wrong == {"sustainable rate"}  # 0.8 / 1.1 ms is 727 Hz
    assert found["sustainable rate"].fix == "set servo.schedule=pipelined"
    for schedule in ("pipelined", "auto"):
        found = judged(TIMER, schedule)
        assert all(finding.ok and not finding.fix for finding in found.values())


def test_replies_held_for_16_ms_point_to_the_latency_timer_and_to_no_schedule() -> None:
    for schedule in ("immediate", "pipelined", "auto"):
        found = judged(FACTORY, schedule)
        assert not found["sustainable rate"].ok
        assert "latency timer" in found["sustainable rate"].fix
        assert "servo.schedule" not in found["sustainable rate"].fix


def test_the_wire_limits_the_rate_however_quick_the_replies() -> None:
    # 58 bytes of ten bits each at 57600 bit/s: 10.1 ms, which the configuration allows to be 0.8
    # of a period.
    slow, fast = (sustainable_hz(QUICK, baud, 0.05) for baud in (57_600, 4_000_000))
    assert slow["pipelined"] == pytest.approx(79.45, abs=0.01)
    assert fast["immediate"] == pytest.approx(0.8 / 0.145e-3)


def test_lost_replies_are_wrong_however_quick_the_others_are() -> None:
    poor = replies([MS // 10] * 180, MS // 10, 15, 5)
    found = judged(poor)
    assert not found["reply time"].ok
    assert "15 lost, 5 broken of 200" in found["reply time"].found
    assert "cable" in found["reply time"].fix  # and not a lower rate
    none = judged(replies([], 0, 200))
    assert not none["reply time"].ok
    assert "sustainable rate" not in none


def test_strict_insists_on_scheduler_and_memory_and_the_rest_is_advice() -> None:
    refused = [
        Check(name, False, "refused", "wanted", f"remedy of {name}")
        for name in ("scheduler", "memory", "cpu latency")
    ]
    assert [f.ok for f in judge_rights(refused, "strict")] == [False, False, True]
    advised = judge_rights(refused, "best-effort")
    assert all(f.ok for f in advised)
    assert [f.fix for f in advised] == [s.fix for s in refused]
    (off,) = judge_rights([], "off")
    assert not off.applies


def test_late_wake_ups_are_wrong_from_a_quarter_of_the_period_on() -> None:
    assert judge_lateness([0] * 98 + [249_000] * 2, MS).ok
    late = [0] * 98 + [250_000] * 2
    assert not judge_lateness(late, MS).ok
    assert "real-time rights" in judge_lateness(late, MS).fix
    assert "rights" not in judge_lateness(late, MS, granted=True).fix
