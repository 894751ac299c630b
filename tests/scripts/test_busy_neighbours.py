"""The table of runs beside busy processes describes their reports."""

from scripts.studies.busy_neighbours import Run, cells, of_report

REPORT = {
    "ticks": 90,
    "missed_ticks": 10,
    "stop_reason": "duration",
    "guard": {"interval_s": 0.002},
    "warnings": [],
}


def test_what_counts_of_a_report() -> None:
    assert of_report(REPORT) == Run("duration", 0.1, 2.0, warned=False)
    warned = {**REPORT, "guard": None, "warnings": ["more than safety.max_missed (20%)"]}
    assert of_report(warned) == Run("duration", 0.1, None, warned=True)


def test_a_trip_is_counted_and_named() -> None:
    runs = [of_report(REPORT)] * 2 + [Run("trip:missed_periods", 0.4, 3.0, warned=True)]
    found = cells("simulated", runs)
    assert found == ["`simulated`", "3", "1", "trip:missed_periods", "10.00%, 40.00%", "2, 3"]
