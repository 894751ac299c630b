"""The table of runs in a second terminal describes their reports."""

from dataclasses import replace

from scripts.studies.second_terminal import PRESET, Run, cells, of_report

REPORT = {
    "ticks": 90,
    "missed_ticks": 10,
    "stop_reason": "duration",
    "bus": {"cycles": 200, "lost": 20},
    "realtime": [{"name": "scheduler", "ok": True}],
}


def test_what_counts_of_a_report() -> None:
    found = replace(of_report(REPORT), load=0.0)
    assert found == Run("duration", lost=0.1, missed=0.1, scheduler=True)
    found = replace(of_report({**REPORT, "bus": None, "realtime": []}), load=0.0)
    assert found == Run("duration", 0.0, 0.1, False)


def test_trips_are_counted_and_named() -> None:
    runs = [of_report(REPORT)] * 2 + [Run("trip:loss_rate", 0.4, 0.2, scheduler=True)]
    found = cells(PRESET, runs)
    ends = ["`emulated-port`", "2 of 3", "trip:loss_rate 1"]
    assert found == [*ends, "10.0%, 40.0%", "10.0%, 20.0%", "yes"]
