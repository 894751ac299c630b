"""The page on the benchmark has a place for every section, and the script fills it."""

import sys
from pathlib import Path

import pytest

from haptic_wall.controller.cli.bench import SECTIONS
from scripts import bench_page
from scripts.bench_page import renewed
from tests.docs.pages import text_of

ROW = {"name": "p99 of a|b", "value": 12.25, "unit": "µs", "low": 11.0, "high": 14.5}
SECTION = {"rows": [ROW], "notes": ["x is missing"], "seconds": 8.0, "steal_percent": 0.25}
REPORT = {
    "machine": {
        "processor": "Made-up", "cores": 2, "system": "Linux 1", "kernel": "#1", "realtime": [],
        "load_average": [0.1, 0.2, 0.3], "steal_percent": 0.5,
    },
    "versions": {"python": "3.11.7", "mujoco": None},
    "seconds": 60.0,
}  # fmt: skip


def test_the_page_has_a_place_for_every_section() -> None:
    text = text_of("docs/evidence/bench.md")
    assert [n for n in ("machine", *SECTIONS) if f"<!-- bench: {n} -->" not in text] == []


PAGE = "a\n<!-- bench: {} -->\nold\n<!-- end -->\nb\n"
TEXT = "".join(PAGE.format(name) for name in ("machine", "boundary", "detector"))


def test_a_part_of_the_benchmark_says_itself_what_the_machine_did_meanwhile() -> None:
    new = renewed(TEXT, {**REPORT, "sections": {"boundary": SECTION}})
    assert (
        "Measured apart from the rest: load 0.10 before, 0.5 % of the processors' time taken by"
        " the host in 60 s. 8 s, 0.25 %"
    ) in new
    assert new.count("\nold\n") == 2  # of the machine and of the detector
    assert renewed(new, {**REPORT, "sections": {"boundary": SECTION}}) == new


def test_what_was_measured_is_written_and_the_rest_stays() -> None:
    report = {**REPORT, "sections": dict.fromkeys(SECTIONS, SECTION)}
    new = renewed(TEXT + PAGE.format("else"), report)
    assert "| p99 of a/b | 12.2 | µs | 11 to 14.5 |" in new
    assert "8 s, 0.25 % of the processors' time taken by the host." in new
    assert "- x is missing\n" in new
    assert "- Made-up, 2 cores, Linux 1, #1\n- python 3.11.7, mujoco not installed\n" in new
    assert "apart" not in new
    assert new.count("\nold\n") == 1  # of what no benchmark measures
    assert new.count("a\n<!-- bench:") == new.count("<!-- end -->\nb\n") == 4
    assert renewed(new, report) == new


@pytest.mark.parametrize("text", [None, "no JSON", "{}", "[]"])
def test_a_report_that_is_none_is_refused_in_a_sentence(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, text: str | None
) -> None:
    page, report = tmp_path / "bench.md", tmp_path / "report.json"
    page.write_text(text_of("docs/evidence/bench.md"), encoding="utf-8")
    if text is not None:
        report.write_text(text, encoding="utf-8")
    monkeypatch.setattr(sys, "argv", ["bench_page", "--report", str(report), "--out", str(page)])
    with pytest.raises(SystemExit, match=r"--report .*report\.json: "):
        bench_page.main()
    assert page.read_text(encoding="utf-8") == text_of("docs/evidence/bench.md")
