"""``presets`` and ``config`` answer what can be set, in what unit, and what is in force."""

import pytest

from haptic_wall.controller.settings.fields import fields
from haptic_wall.controller.settings.load import load_config, preset_names
from tests.support.program import Cli


def test_presets_are_listed_one_a_line(cli: Cli) -> None:
    lines = cli("presets").out.splitlines()
    assert [line.split()[0] for line in lines] == preset_names()
    assert all(len(line.split()) > 5 for line in lines)


@pytest.mark.parametrize("name", preset_names())
def test_config_as_json_holds_every_field_and_its_effective_value(name: str, cli: Cli) -> None:
    listed = cli.json("config", name)
    effective = load_config(name).config
    assert listed["servo"] == effective.servo.kind
    assert [path for path in listed["fields"] if not path.startswith("axes.")] == list(fields())
    assert listed["fields"]["wall.stiffness"]["value"] == effective.wall.stiffness
    assert listed["fields"]["wall.stiffness"]["unit"] == "N·m/rad"


def test_config_as_text_names_value_unit_range_and_meaning(cli: Cli) -> None:
    text = " ".join(cli("config", "simulated").out.split())
    assert "wall.stiffness 8 N·m/rad Requested stiffness K," in text
    assert "(a number above 0 and below 1)" in text
    assert all(path in text for path in fields())


def test_config_shows_bounds_of_the_belief_and_marks_what_is_not_used(cli: Cli) -> None:
    lines = cli("config", "xm430-w350").out.splitlines()
    (inertia,) = [line for line in lines if "  model.inertia" in line]
    assert "0.011951 (0.007967 to 0.017927)" in inertia
    unused = [line[2:].split()[0] for line in lines if line.startswith("- ")]
    assert unused == [each.path for each in fields().values() if "hardware" not in each.used_by]
    assert {"servo.inertia", "servo.hand"} < set(unused)


def test_config_shows_what_the_bus_section_gives(cli: Cli) -> None:
    sets = ("--set=bus.port=/dev/ttyUSB8", "--set=bus.baud=1000000")
    listed = cli.json("config", "xm430-w350", *sets)["fields"]
    both = {path: listed[path]["value"] for path in ("bus.port", "bus.baud")}
    assert both == {"bus.port": "/dev/ttyUSB8", "bus.baud": 1000000}


def test_config_shows_what_an_axis_has_of_its_own(cli: Cli) -> None:
    sets = ["axes={a: {wall: {law: none}}, b: {servo: {inertia: 0.02}}}"]
    sets += ["axes.b.wall.stiffness=8"]
    listed = cli.json("config", "simulated", *(f"--set={each}" for each in sets))
    own = {path: each["value"] for path, each in listed["fields"].items() if "axes" in path}
    assert own == {
        "axes.a.wall.law": "none",
        "axes.b.wall.stiffness": 8.0,
        "axes.b.servo.inertia": 0.02,
    }
