"""What a report is made of: bins, percentiles, the host's share."""

from pathlib import Path

from haptic_wall.controller.bench.machine import ProcessorTime, processor_time, stolen_percent


def test_the_hosts_share_is_of_all_processors_time(tmp_path: Path) -> None:
    stat = tmp_path / "stat"
    # A guest's 40 ticks are counted in the user's 100 already.
    stat.write_text("cpu  100 0 50 800 10 0 5 35 40 0\ncpu0 1 1\n", encoding="ascii")
    before = processor_time(stat)
    assert before == ProcessorTime(1000, 35)
    assert stolen_percent(before, ProcessorTime(1400, 45)) == 2.5
    assert stolen_percent(before, before) is None
    assert stolen_percent(None, before) is None
    stat.write_text("cpu  1 2 3\n", encoding="ascii")
    assert processor_time(stat) is None
    assert processor_time(tmp_path / "none") is None
