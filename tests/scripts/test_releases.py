"""A release that became slower is told from one that did not; entries are read strictly."""

import json
from dataclasses import asdict, replace
from pathlib import Path

import pytest

from scripts.release_figures import BENCH, Figure, kept
from scripts.releases import FOLDER, PAGE, Entry, entries, main, page_lines, read, renewed, worse

FAST = Figure("import", "1", True, 1.0, 0.95, 1.05)
RATE = Figure("rate", "1", False, 0.8, 0.78, 0.82)
OLD = Entry("0.1.0", "aaaa", "2026-01-01T10:00", "a machine", 0.1, 5, "numpy 2", {"import": FAST})


@pytest.mark.parametrize(
    ("now", "before", "expected"),
    [
        (replace(FAST, value=1.3, low=1.2, high=1.4), FAST, True),
        (replace(FAST, value=1.3, low=1.0, high=1.4), FAST, False),  # the rounds overlap
        (replace(FAST, value=1.08, low=1.07, high=1.09), FAST, False),  # hardly
        (replace(FAST, value=0.5, low=0.4, high=0.6), FAST, False),  # better
        (replace(RATE, value=0.6, low=0.58, high=0.62), RATE, True),
        (replace(RATE, value=0.9, low=0.88, high=0.92), RATE, False),
        (Figure("t", "1", True, 2.0), Figure("t", "1", True, 1.0), True),  # one round each
        (Figure("tests", "tests", None, 1.0), Figure("tests", "tests", None, 9.0), False),
    ],
)
def test_only_what_is_clearly_worse_is_called_so(
    now: Figure, before: Figure, expected: bool
) -> None:
    assert worse(now, before) is expected


def test_the_table_marks_the_release_that_became_slower() -> None:
    slow = replace(FAST, value=2.0, low=1.9, high=2.1)
    new = replace(OLD, commit="bbbb", figures={"import": slow, "rate": RATE})
    third = replace(OLD, commit="cccc", figures={"rate": replace(RATE, value=0.4, high=0.5)})
    lines = page_lines([OLD, new, third])
    (imports,) = (line for line in lines if line.startswith("| import"))
    (rates,) = (line for line in lines if line.startswith("| rate"))
    assert imports == "| import | less | 1 (0.95 to 1.05) | **worse:** 2 (1.9 to 2.1) |  |"
    assert rates == "| rate | more |  | 0.8 (0.78 to 0.82) | **worse:** 0.4 (0.78 to 0.5) |"
    assert (
        "- 0.1.0, 2026-01-01, aaaa: a machine; numpy 2; 5 rounds, load 0.1 when it began" in lines
    )


def test_entries_come_back_in_the_order_of_their_commits(tmp_path: Path) -> None:
    new = replace(OLD, commit="0000", committed="2026-01-01T11:00")
    for one in (new, OLD):
        (tmp_path / f"{one.commit}.json").write_text(json.dumps(asdict(one)))
    assert entries(tmp_path) == [OLD, new]


@pytest.mark.parametrize("text", ["{", "[]", "{}", '{"figures": {"a": {}}}'])
def test_a_file_that_is_no_entry_is_refused(tmp_path: Path, text: str) -> None:
    (tmp_path / "a.json").write_text(text)
    with pytest.raises(ValueError, match="found no entry of a release"):
        read(tmp_path / "a.json")


def test_only_the_part_of_the_page_changes() -> None:
    page = "before\n<!-- releases -->\nold\n<!-- end -->\nbehind\n"
    assert renewed(page, ["new"]) == "before\n<!-- releases -->\n\nnew\n\n<!-- end -->\nbehind\n"


def test_ratios_are_found_in_a_report_of_the_benchmark() -> None:
    name = "haptic-wall, highest rate: over that of the bare loop, in the same round"
    rows: list[dict[str, object]] = [
        {"name": "bare loop, highest rate", "value": 4000.0, "low": None, "high": None},
        {"name": name, "value": 0.8, "low": 0.7, "high": 0.9},
    ]
    found = kept(rows, "highest_rate")
    assert list(found) == list(BENCH["highest_rate"])
    assert found["highest_rate"].value == 0.8
    assert found["highest_rate"].less_is_better is False


def test_the_page_is_made_of_the_entries(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    page = tmp_path / "releases.md"
    page.write_text(PAGE.read_text(encoding="utf-8"), encoding="utf-8")
    monkeypatch.setattr("sys.argv", ["releases", "--out", str(page)])
    main()
    assert page.read_text(encoding="utf-8") == PAGE.read_text(encoding="utf-8")
    assert entries(FOLDER), "there is an entry"
