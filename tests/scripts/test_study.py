"""A study's rows are kept as they come, its page is renewed in parts, and the pages know it."""

import importlib
import json
import re
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest

from scripts import study
from scripts.study import ROOT, Option, Part, Study, listed, main, renewed, run
from tests.docs.pages import PAGES, commands

STUDIES = [name for name, _ in listed() if (ROOT / "scripts" / "studies" / f"{name}.py").exists()]
COMPUTED = re.compile(r"^<!-- computed: ([\w-]+)(?: at \w+)? -->", re.M)
asked: list[Any] = []


@dataclass(frozen=True)
class Row:
    """A record with what JSON does not have of itself."""

    squared: float
    pair: tuple[int, ...]


def squared(case: int) -> Row:
    asked.append(case)
    return Row(float("inf") if case == 3 else float(case * case), (case, case))


def lines(found: Any) -> list[str]:
    return [f"{case}: {row.squared:g} {row.pair}" for case, row in found]


PART = Part("squares", lambda given: range(given.count), squared, lines, in_turn=True)
STUDY = Study("squares.md", (PART,), (Option("count", 5, "of squares", quick=2),))
PAGE = "before\n<!-- computed: squares -->\nold\n<!-- end -->\nbehind\n"


@pytest.fixture
def page(tmp_path: Path) -> Path:
    asked.clear()
    place = tmp_path / "squares.md"
    place.write_text(PAGE)
    return place


def call(page: Path, *options: str) -> tuple[int, str]:
    status = run(STUDY, "squares", "Squares.", ["--out", str(page), *options])
    return status, page.read_text()


def test_the_part_is_made_anew_and_the_rest_stays(page: Path) -> None:
    status, text = call(page, "--count", "3")
    assert status == 0
    assert re.match(
        r"before\n<!-- computed: squares( at \w+)? -->\nBy `scripts/study squares --count 3`", text
    )
    assert "\n0: 0 (0, 0)\n1: 1 (1, 1)\n2: 4 (2, 2)\n<!-- end -->\nbehind\n" in text
    assert "old" not in text


def test_a_later_call_goes_on_where_one_ended(page: Path, tmp_path: Path) -> None:
    rows = tmp_path / "rows"
    call(page, "--count", "4", "--rows", str(rows))
    assert [json.loads(line)[1] for line in rows.read_text().splitlines()] == ["0", "1", "2", "3"]
    asked.clear()
    _, text = call(page, "--count", "6", "--rows", str(rows))
    assert asked == [4, 5]
    assert "3: inf (3, 3)\n" in text and "5: 25 (5, 5)\n" in text


def test_a_missing_place_is_one_sentence_on_the_command_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    page = tmp_path / "page.md"
    page.write_text("no place")
    assert main(["identify_check", "--out", str(page)]) == 2
    said = capsys.readouterr().err
    assert said.startswith("scripts/study identify_check: the page has no place for ")
    assert len(said.splitlines()) == 1


def test_without_a_name_it_lists_them_and_an_unknown_one_is_refused(
    capsys: pytest.CaptureFixture[str],
) -> None:
    assert main([]) == 0
    said = capsys.readouterr().out
    assert "kill_times" in said and "same_rows" in said
    assert main(["no_such"]) == 2


def test_the_list_says_which_parts_are_of_older_code(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    part = "<!-- computed: NAME -->\nfigures\n<!-- end -->\n"
    docs = tmp_path / "docs"
    docs.mkdir()
    (docs / "page.md").write_text(
        part.replace("NAME", "new at abc1")
        + part.replace("NAME", "old at abc2")
        + part.replace("NAME", "lost")
    )
    counts = {"abc1..HEAD": "0", "abc2..HEAD": "7"}
    monkeypatch.setattr(study, "ROOT", tmp_path)
    monkeypatch.setattr(study, "git", lambda *words: counts[words[2]])
    assert [*study.older()] == [
        "docs/page.md, old: 7 commits",
        "docs/page.md, lost: of an unknown commit",
    ]


@pytest.mark.parametrize("name", STUDIES)
def test_each_study_has_its_place_on_a_page_and_says_what_it_takes(
    name: str, capsys: pytest.CaptureFixture[str]
) -> None:
    module = importlib.import_module(f"scripts.studies.{name}")
    text = (ROOT / "docs" / module.STUDY.page).read_text(encoding="utf-8")
    renewed(text, {part.name: [] for part in module.STUDY.parts})
    assert f"scripts/study {name}" in text, "the page says what makes it again"
    with pytest.raises(SystemExit, match="0"):
        run(module.STUDY, name, module.__doc__ or "", ["--help"])
    assert f"scripts/study {name}" in capsys.readouterr().out
    assert all(part.row.__annotations__["return"] for part in module.STUDY.parts)


def test_no_part_of_a_page_is_nobodys() -> None:
    theirs = {
        (each.page, part.name)
        for each in (importlib.import_module(f"scripts.studies.{n}").STUDY for n in STUDIES)
        for part in each.parts
    }
    docs = ROOT / "docs"
    found = {
        (str(page.relative_to(docs)), name)
        for page in PAGES
        if page.is_relative_to(docs)
        for name in COMPUTED.findall(page.read_text(encoding="utf-8"))
    }
    assert found == theirs


def test_every_script_that_a_page_names_is_there() -> None:
    names = {name for name, _ in listed()}
    there = {name for each in (ROOT / "scripts").iterdir() for name in (each.name, each.stem)}
    wrong = []
    for page in PAGES:
        for place, name in re.findall(
            r"(?<!tests/)\bscripts/([\w-]+)(?: (\w+))?", page.read_text("utf-8")
        ):
            known = name in {*names, "", "NAME"} if place == "study" else place in there
            wrong += [] if known else [f"{page.name}: scripts/{place} {name}"]
    assert wrong == []
    assert all(words[1] in names for _, words in commands() if words[0] == "scripts/study")
