"""The report as text holds what a person asks first; as JSON it holds no NaN."""

import json
import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from haptic_wall.controller.cli.options import as_json
from haptic_wall.controller.report.run_text import report_text

TIMES = {"p50": 0.123456, "p99": 15.1, "p99_9": 31.9, "max": 310.0}
REPORT: dict[str, Any] = {
    "ticks": 4998,
    "duration_s": 5.0,
    "missed_ticks": 2,
    "rate_hz": 999.6,
    "grid_hz": 1000.0,
    "lateness_us": TIMES,
    "work_us": TIMES,
    "bus_us": TIMES,
    "bus": {
        "schedule": "immediate",
        "cycles": 4998,
        "lost": 1,
        "late": 1,
        "corrupt": 0,
        "sample_age_us": {"p50": 120.0, "p99": 300.0, "max": 900.0},
    },
    "delay_s": {"inserted": 0.002, "device": 0.0, "measured": 0.00014, "total": 0.00214},
    "guard": {
        "requested": {"stiffness": 1e6, "damping": 0.02},
        "commanded": {"stiffness": 5.5, "damping": 0.02},
        "limit": {
            "linear": 12.0,
            "exact": 11.9,
            "one_sided": 6.875,
            "quantisation": None,
            "passive": None,
        },
        "damping_ceiling": 3.2,
        "margin": 0.8,
        "binding": "one_sided",
        "reasons": [
            "stiffness 1e+06 asked, 5.5 commanded: a one-sided wall this stiff would throw "
            "the servo back faster than it came"
        ],
        "only_friction": True,
    },
    "oscillation": None,
    "torque": {"max": 1.234, "saturated_ticks": 7},
    "stop_reason": "duration",
    "explanation": None,
    "torque_off": True,
    "servo_checks": [],
    "realtime": [
        {"name": "scheduler", "wanted": "FIFO", "found": "refused", "ok": False, "fix": "x"},
        {"name": "memory", "wanted": "locked", "found": "locked", "ok": True, "fix": ""},
    ],
    "warnings": ["scheduler: wanted FIFO, refused; to grant it: x"],
    "log": "runs/a long way/run.hwlog",
    "plot": "runs/run.png",
}


def joined(report: Mapping[str, Any]) -> str:
    return " ".join(report_text(report).split())


def test_a_wall_that_was_never_on_is_not_as_requested() -> None:
    assert "was never on" in joined(REPORT | {"wall_came_on": False})
    assert "was never on" not in joined(REPORT | {"wall_came_on": True})


def test_the_report_of_several_axes_has_a_line_for_each() -> None:
    part = {key: REPORT[key] for key in ("guard", "oscillation", "torque")}
    stop = {"stop_reason": "trip:travel", "stop_axis": "elbow", "guard": None}
    told = report_text(REPORT | stop | {"axes": {"arm": part, "elbow": part}}, brief=True)
    assert "ENDED BY A SAFETY TRIP: travel of elbow" in told
    said = "5.5 N·m/rad of 1e+06 requested"
    assert f"axis        arm: {said}" in told and f"axis        elbow: {said}" in told
    assert told.count("stiffness 1e+06 asked") == 1, "the reason is the same"


def test_the_whole_report_of_several_axes_tells_readings_and_the_probe_of_another_axis() -> None:
    part = {key: REPORT[key] for key in ("guard", "oscillation", "torque")}
    seen = {"state": "quiet", "probes": 0, "probed_s": 11.104}
    told = joined(REPORT | {"axes": {"arm": part | {"oscillation": seen}, "elbow": part}})
    assert "bus 4998 readings of 2 servos, immediate: 1 lost" in told
    assert "quiet; no probe of its own, wall softer for 11 s;" in told


def test_the_report_tells_what_happened_in_some_25_lines() -> None:
    text = joined(REPORT)
    for fact in (
        "run ended as planned; torque is off, read back",
        "ticks 4998 at 999.6 Hz, 0.04 % missed; late by p99 15.1, max 310 µs; delay 2.140 ms",
        "lateness p50 0.123, p99 15.1, p99.9 31.9, max 310 µs",
        "bus 4998 cycles, immediate: 1 lost, 1 late, 0 corrupt; sample age p99 300 µs",
        "delay 2.140 ms = inserted 2.000 + device 0.000 + measured 0.140 ms",
        "wall 5.5 N·m/rad of 1e+06 requested, 0.02 N·m·s/rad, limited by one_sided",
        "linear 12, exact 11.9, one_sided 6.875* N·m/rad x margin 0.8; * binds; damping",
        "; damping ceiling 3.2",
        "would throw the servo back faster than it came",
        "torque at most 1.234 N·m, the limit cut it in 7 ticks",
        "granted: memory (1 of 2)",
    ):
        assert fact in text
    lines = report_text(REPORT).splitlines()
    assert 12 <= len(lines) <= 27
    assert max(map(len, lines)) <= 98
    assert "log         runs/a long way/run.hwlog" in lines


def test_a_trip_is_the_first_thing_one_reads() -> None:
    report = REPORT | {
        "stop_reason": "trip:overspeed",
        "explanation": "the shaft moved faster than safety.max_speed allows",
        "torque_off": False,
    }
    first, second, *others = report_text(report).splitlines()
    assert "ENDED BY A SAFETY TRIP: overspeed; TORQUE OFF COULD NOT BE READ BACK" in first
    assert "safety.max_speed" in second
    meaning = " ".join(" ".join(others[:2]).split())
    for fact in ("did not confirm", "Bus Watchdog ends it", "switch its power off"):
        assert fact in meaning


def test_what_is_not_known_is_left_out_or_named() -> None:
    report = REPORT | {
        "rate_hz": None,
        "lateness_us": dict.fromkeys(TIMES),
        "bus": None,
        "delay_s": None,
        "guard": None,
        "realtime": [],
        "plot": None,
        "torque_off": None,
    }
    text = joined(report)
    late = {**REPORT, "lateness_us": {**TIMES, "p99": 2450.0, "max": 27460.0}}
    assert "late by p99 2450, max 27460 µs" in joined(late), "no exponent"
    assert "unknown Hz" in text
    assert "None" not in text
    assert "picture" not in text


def test_json_is_what_json_is() -> None:
    value = {
        "nan": math.nan,
        "inf": [math.inf, -math.inf, 1.5],
        "numpy": np.float64("nan"),
        "count": np.int64(3),
        "array": np.array([1.0, np.inf]),
        "path": Path("runs/x.png"),
        "tuple": (1, {"deep": math.nan}),
    }
    assert json.loads(as_json(value)) == {
        "nan": None,
        "inf": [None, None, 1.5],
        "numpy": None,
        "count": 3,
        "array": [1.0, None],
        "path": "runs/x.png",
        "tuple": [1, {"deep": None}],
    }


REASON = REPORT["guard"]["reasons"][0]


def test_the_default_report_has_about_eight_lines_and_the_first_reason() -> None:
    many = {"warnings": [f"note {k}" for k in range(9)], "oscillation": {"state": "quiet"}}
    lines = report_text(REPORT | many, brief=True).splitlines()
    assert len(lines) == 11
    assert lines[0] == "run         ended as planned; torque is off, read back"
    assert lines[1] == "oscillation quiet; torque at most 1.234 N·m, the limit cut it in 7 ticks"
    assert lines[2] == (
        "wall        5.5 N·m/rad of 1e+06 requested, 0.02 N·m·s/rad, limited by one_sided"
    )
    assert " ".join("".join(lines[3:5]).split()) == f"why {REASON}"
    assert lines[5].startswith("ticks       4998 at 999.6 Hz, 0.04 % missed; late by p99 15.1, max")
    assert lines[6].startswith("bus         4998 cycles, immediate: 1 lost, 1 late, 0 corrupt")
    assert lines[7] == "note        note 8"
    assert lines[8] == "more        8 notes: `haptic-wall log 'runs/a long way/run.hwlog'`"
    assert lines[9:] == ["log         runs/a long way/run.hwlog", "picture     runs/run.png"]


@pytest.mark.parametrize("state", ["incomplete", "missing"])
def test_a_log_without_the_report_is_not_where_its_notes_are(state: str) -> None:
    many = {"warnings": [f"note {k}" for k in range(9)], "log_state": state}
    text = report_text(REPORT | many, brief=True)
    assert all(f"note        note {k}\n" in text for k in range(9))
    assert "more" not in text and "haptic-wall log" not in text
