"""Nothing is kept that nobody uses, and the search for it finds what is there to be found."""

from __future__ import annotations

import pytest

from tests.reachability import entry_points, outside, template_words, unused

LOG = "haptic_wall.controller.logs"


def test_every_definition_is_used_by_a_command_a_plugin_a_page_or_a_script() -> None:
    assert unused(outside(), entry_points(), template_words()) == []


@pytest.mark.whole
def test_what_only_one_entry_point_uses_is_found_without_it() -> None:
    without = [node for node in entry_points() if node[0] != "haptic_wall.controller.cli.log"]
    found = unused(outside(), without, template_words())
    assert f"{LOG}.mcap_export.write_mcap" in found
    assert not any(name.startswith("haptic_wall.controller.runtime.tick.") for name in found)
