"""The presets' walls are those of the page, quiet and as requested by the guard's leave."""

import pytest

from haptic_wall.controller.settings.load import load_config
from scripts.first_touch import CANDIDATES, PAGE, row


@pytest.mark.parametrize("preset", CANDIDATES)
def test_the_presets_wall_is_chosen_from_the_table(preset):
    wall = load_config(preset).config.wall
    found = row((preset, wall.stiffness, wall.damping))
    assert found in PAGE.read_text(), "run scripts/first_touch"
    cells = [cell.strip() for cell in found.strip("|").split("|")]
    assert cells[1] == f"{wall.stiffness:g}", "nothing of it is taken away"
    assert cells[-2:] == ["none; none"] * 2, "no corner swings, at no lag"
