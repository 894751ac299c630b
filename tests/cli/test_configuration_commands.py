"""``presets`` and ``config`` answer what can be set, in what unit, and what is in force."""

import json
from types import ModuleType

import pytest
from click.testing import CliRunner

from haptic_wall.controller.cli import config, presets
from haptic_wall.controller.settings.fields import fields
from haptic_wall.controller.settings.load import load_config, preset_names


def answer(module: ModuleType, *arguments: str) -> str:
    result = CliRunner().invoke(module.command, arguments, catch_exceptions=False)
    assert result.exit_code == 0
    return result.stdout


def test_presets_are_listed_one_a_line() -> None:
    lines = answer(presets).splitlines()
    assert [line.split()[0] for line in lines] == preset_names()
    assert all(len(line.split()) > 5 for line in lines)


@pytest.mark.parametrize("name", preset_names())
def test_config_as_json_holds_every_field_and_its_effective_value(name: str) -> None:
    listed = json.loads(answer(config, name, "--json"))
    effective = load_config(name).config
    assert listed["servo"] == effective.servo.kind
    assert [path for path in listed["fields"] if not path.startswith("axes.")] == list(fields())
    assert listed["fields"]["wall.stiffness"]["value"] == effective.wall.stiffness
    assert listed["fields"]["wall.stiffness"]["unit"] == "N·m/rad"


def test_config_as_text_names_value_unit_range_and_meaning() -> None:
    text = " ".join(answer(config, "simulated").split())
    assert "wall.stiffness 8 N·m/rad Requested stiffness K," in text
    assert "(a number above 0 and below 1)" in text
    assert all(path in text for path in fields())


def test_config_shows_bounds_of_the_belief_and_marks_what_is_not_used() -> None:
    lines = answer(config, "xm430-w350").splitlines()
    (inertia,) = [line for line in lines if "  model.inertia" in line]
    assert "0.011951 (0.007967 to 0.017927)" in inertia
    unused = [line[2:].split()[0] for line in lines if line.startswith("- ")]
    assert unused == [each.path for each in fields().values() if "hardware" not in each.used_by]
    assert {"servo.inertia", "servo.hand"} < set(unused)


def test_config_shows_what_the_bus_section_gives() -> None:
    sets = ("--set=bus.port=/dev/ttyUSB8", "--set=bus.baud=1000000")
    listed = json.loads(answer(config, "xm430-w350", "--json", *sets))["fields"]
    both = {path: listed[path]["value"] for path in ("bus.port", "bus.baud")}
    assert both == {"bus.port": "/dev/ttyUSB8", "bus.baud": 1000000}


def test_config_shows_what_an_axis_has_of_its_own() -> None:
    sets = ["axes={a: {wall: {law: none}}, b: {servo: {inertia: 0.02}}}"]
    sets += ["axes.b.wall.stiffness=8"]
    listed = json.loads(answer(config, "simulated", "--json", *(f"--set={each}" for each in sets)))
    own = {path: each["value"] for path, each in listed["fields"].items() if "axes" in path}
    assert own == {
        "axes.a.wall.law": "none",
        "axes.b.wall.stiffness": 8.0,
        "axes.b.servo.inertia": 0.02,
    }
