"""What measurements mean: which schedule suits, which rate holds, what the machine grants."""

import pytest

from controller.doctor.machine import examine_core, judge_lateness, judge_rights
from controller.doctor.timing import Wanted, judge_replies, judge_series, suits, sustainable_hz
from controller.realtime import Setting
from hw.dynamixel.examine.cycles import Phase, Replies, Series, percentile

MS = 1_000_000
QUICK = Replies([MS // 10] * 200, 0, 0, 2048, 2048)
TIMER = Replies([k * MS // 200 + MS // 10 for k in range(200)], 0, 0, 2048, 2049)
HELD = Replies([16 * MS] * 200, 0, 0, 2048, 2048)


def wanted(schedule="immediate", rate_hz=1000.0, baud=4_000_000):
    return Wanted(schedule, rate_hz, baud)


def series(schedule, *shares, age_ns=MS):
    phases = [
        Phase(k, 100, round(100 * s), [age_ns] * round(100 * (1 - s))) for k, s in enumerate(shares)
    ]
    return Series(schedule, phases, [0], 0)


def by_name(findings):
    return {finding.name: finding for finding in findings}


def test_percentiles_are_nearest_ranks():
    numbers = list(range(1, 101))
    assert [percentile(numbers, share) for share in (0.5, 0.99, 1.0)] == [50, 99, 100]
    assert percentile([7], 0.01) == 7


def test_quick_replies_are_well_in_both_schedules():
    for schedule in ("immediate", "pipelined"):
        assert all(f.ok and not f.fix for f in judge_replies(QUICK, wanted(schedule)))


def test_a_timer_of_1_ms_is_too_slow_for_immediate_and_pipelined_is_named():
    found = by_name(judge_replies(TIMER, wanted()))
    assert not found["reply time"].ok
    assert "servo.schedule=pipelined" in found["sustainable rate"].fix
    assert all(finding.ok for finding in judge_replies(TIMER, wanted("pipelined")))


def test_replies_held_for_16_ms_point_to_the_latency_timer():
    found = by_name(judge_replies(HELD, wanted("pipelined")))
    assert "latency timer" in found["reply time"].fix
    assert "loop.rate_hz=100" in found["sustainable rate"].fix  # 1.8 periods of 10 ms


def test_the_wire_limits_the_rate_however_quick_the_replies():
    # 58 bytes of ten bits each at 57600 bit/s: 10.1 ms
    assert sustainable_hz(QUICK, "pipelined", 57_600) == pytest.approx(99.31, abs=0.01)
    # ... and 0.145 ms at 4 Mbit/s
    assert sustainable_hz(QUICK, "immediate", 4_000_000) == pytest.approx(1 / 0.145e-3)


def test_lost_replies_are_wrong_however_quick_the_others_are():
    poor = Replies([MS // 10] * 180, 15, 5, 0, 0)
    finding = by_name(judge_replies(poor, wanted()))["reply time"]
    assert not finding.ok
    assert "15 lost, 5 broken of 200" in finding.found
    (none,) = judge_replies(Replies([], 200, 0, 0, 0), wanted())
    assert not none.ok


def test_an_encoder_that_moves_is_told_and_is_not_wrong():
    finding = by_name(judge_replies(Replies([MS] * 9, 0, 0, 5, 25), wanted()))["encoder at rest"]
    assert finding.ok
    assert "20 counts" in finding.found
    assert finding.fix


def test_the_youngest_samples_that_come_at_every_phase_are_recommended():
    both = [series("immediate", 0, 0, age_ns=MS // 5), series("pipelined", 0, 0)]
    assert suits(both) == "immediate"
    assert suits([series("immediate", 0, 1), series("pipelined", 0, 0.04)]) == "pipelined"
    assert suits([series("immediate", 0, 1), series("pipelined", 0, 0.06)]) is None


def test_a_schedule_that_fails_at_one_phase_is_wrong_only_if_it_is_the_configured_one():
    measured = [series("immediate", 0, 0, 1), series("pipelined", 0, 0, 0)]
    found = by_name(judge_series(measured, TIMER, wanted("immediate")))
    assert not found["schedule immediate"].ok
    assert "1 of 3 phases" in found["schedule immediate"].found
    assert not found["schedule"].ok
    assert "servo.schedule=pipelined" in found["schedule"].fix
    assert all(f.ok for f in judge_series(measured, TIMER, wanted("pipelined")))


def test_where_no_schedule_holds_a_lower_rate_is_named():
    measured = [series("immediate", 1, 1), series("pipelined", 1, 1)]
    found = by_name(judge_series(measured, HELD, wanted("pipelined")))
    assert found["schedule"].fix == "set loop.rate_hz=100"


def test_strict_insists_on_scheduler_and_memory_and_the_rest_is_advice():
    refused = [
        Setting(name, "wanted", "refused", False, f"remedy of {name}")
        for name in ("scheduler", "memory", "cpu latency")
    ]
    assert [f.ok for f in judge_rights(refused, "strict")] == [False, False, True]
    advised = judge_rights(refused, "best-effort")
    assert all(f.ok for f in advised)
    assert [f.fix for f in advised] == [s.remedy for s in refused]
    (off,) = judge_rights([], "off")
    assert not off.applies


def test_late_wake_ups_are_wrong_from_a_quarter_of_the_period_on():
    assert judge_lateness([0] * 98 + [249_000] * 2, MS).ok
    assert not judge_lateness([0] * 98 + [250_000] * 2, MS).ok


@pytest.mark.parametrize(
    ("realtime", "isolated", "governor", "hints"),
    [("1", "1-3,5", "performance", 0), ("0", "", "powersave", 3), (None, "2", None, 2)],
)
def test_kernel_and_core_are_advice(tmp_path, realtime, isolated, governor, hints):
    def put(path, text):
        if text is not None:
            (tmp_path / path).parent.mkdir(parents=True, exist_ok=True)
            (tmp_path / path).write_text(text)

    put("kernel/realtime", realtime)
    put("devices/system/cpu/isolated", isolated)
    put("devices/system/cpu/cpu5/cpufreq/scaling_governor", governor)
    found = examine_core(5, tmp_path)
    assert all(finding.ok for finding in found)
    assert sum(bool(finding.fix) for finding in found) == hints
