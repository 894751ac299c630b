"""The tables on oscillations run from end to end, and write counter-examples that run again."""

from __future__ import annotations

from pathlib import Path

import pytest

from scripts.studies import detector_table, reaction_table
from scripts.study import ROOT, Study, run
from scripts.trials.cases import Case
from scripts.trials.run import WallAsked
from scripts.trials.truth import Truth

CASE = {"Case": Case, "Truth": Truth, "WallAsked": WallAsked, "__builtins__": {}}


@pytest.mark.parametrize(
    ("study", "name"),
    [(detector_table.STUDY, "detector_table"), (reaction_table.STUDY, "reaction_table")],
)
def test_the_sections_of_a_page_are_made(tmp_path: Path, study: Study, name: str) -> None:
    page, examples = tmp_path / "page.md", tmp_path / "examples"
    page.write_text((ROOT / "docs" / study.page).read_text())
    sections = [part.name for part in study.parts if part.name != "belief"]
    words = ["--quick", "--seed", "2", "--only", *sections, "--out", str(page)]
    run(study, name, "Tables.", [*words, "--examples", str(examples)])
    for section in sections:
        made = f"<!-- computed: {section} -->\nBy `scripts/study {name} --quick --seed 2`"
        assert made in page.read_text()
    for line in examples.read_text().splitlines():
        if not line.startswith("#"):
            assert isinstance(eval(line, CASE), Case)
