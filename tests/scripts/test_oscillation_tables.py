"""The tables on oscillations run from end to end, and leave what is not made anew."""

from __future__ import annotations

from pathlib import Path

from scripts import detector_table, reaction_table
from scripts.trials.cases import Case
from scripts.trials.run import WallAsked
from scripts.trials.truth import Truth

CASE = {"Case": Case, "Truth": Truth, "WallAsked": WallAsked, "__builtins__": {}}


def test_the_sections_of_the_detectors_page_are_made(tmp_path: Path) -> None:
    page, examples = tmp_path / "page.md", tmp_path / "examples"
    page.write_text("# The detector, tried\n\nhead\n")
    names = list(detector_table.SECTIONS)
    command = ["--quick", "--only", *names, "--out", str(page), "--examples", str(examples)]
    detector_table.main(command)
    text = page.read_text()
    assert text.startswith("# The detector, tried\n\nhead\n\n<!-- section: walls -->\n")
    for section in detector_table.SECTIONS.values():
        assert f"\n## {section.title}\n\nBy `scripts/study detector_table --quick --seed 3`" in text
    for line in examples.read_text().splitlines():
        if not line.startswith("#"):
            assert isinstance(eval(line, CASE), Case)


def test_the_sections_of_the_reactions_page_are_made(tmp_path: Path) -> None:
    page = tmp_path / "page.md"
    reaction_table.main(
        ["--quick", "--only", *reaction_table.SECTIONS, "--seed", "2", "--out", str(page)]
    )
    for section in reaction_table.SECTIONS.values():
        assert f"\n## {section.title}\n\n" in page.read_text()
