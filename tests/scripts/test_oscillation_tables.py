"""The tables on oscillations run from end to end, and write counter-examples that run again."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import pytest

from scripts.studies import detector_table, reaction_table
from scripts.study import ROOT, Given, Part, Study, run
from scripts.trials.cases import Case
from scripts.trials.run import WallAsked
from scripts.trials.truth import Truth

CASE = {"Case": Case, "Truth": Truth, "WallAsked": WallAsked, "__builtins__": {}}


def _shortened(study: Study) -> Study:
    """The study in this process, on a few cases of the first of its servos."""

    def some(part: Part[Any, Any], given: Given) -> list[Any]:
        cases = list(part.cases(given))
        return [case for case in cases if case[0] == cases[0][0]][:3]

    parts = [replace(part, cases=partial(some, part), in_turn=True) for part in study.parts]
    return replace(study, parts=tuple(parts))


@pytest.mark.parametrize(
    ("study", "name"),
    [(detector_table.STUDY, "detector_table"), (reaction_table.STUDY, "reaction_table")],
)
@pytest.mark.whole
def test_the_sections_of_a_page_are_made(tmp_path: Path, study: Study, name: str) -> None:
    page, examples = tmp_path / "page.md", tmp_path / "examples"
    page.write_text((ROOT / "docs" / study.page).read_text())
    sections = [part.name for part in study.parts if part.name != "belief"]
    words = ["--quick", "--seed", "2", "--only", *sections, "--out", str(page)]
    run(_shortened(study), name, "Tables.", [*words, "--examples", str(examples)])
    for section in sections:
        made = f"<!-- computed: {section} -->\nBy `scripts/study {name} --quick --seed 2`"
        assert made in page.read_text()
    for line in examples.read_text().splitlines():
        if not line.startswith("#"):
            assert isinstance(eval(line, CASE), Case)
