"""The presets' walls are those of the page, quiet and as requested by the guard's leave."""

import pytest

from haptic_wall.controller.settings.load import load_config
from scripts.studies.first_touch import CANDIDATES, row
from scripts.study import table
from tests.docs.pages import text_of


@pytest.mark.whole
@pytest.mark.parametrize("preset", CANDIDATES)
def test_the_presets_wall_is_chosen_from_the_table(preset: str) -> None:
    wall = load_config(preset).config.wall
    cells = row((preset, wall.stiffness, wall.damping))
    line = table([], cells)[-1]
    assert line in text_of("docs/evidence/first-touch.md"), "run scripts/study first_touch"
    assert cells[1] == f"{wall.stiffness:g}", "nothing of it is taken away"
    assert cells[-2:] == ["none; none"] * 2, "no corner swings, at no lag"
