"""``init`` writes a preset with what else can be set, and keeps what is there."""

import re
from pathlib import Path

import pytest

from haptic_wall.controller.cli.init import commented
from haptic_wall.controller.settings.fields import fields
from haptic_wall.controller.settings.load import load_config, preset_names, preset_text
from tests.support.program import Cli


@pytest.mark.parametrize("preset", preset_names())
def test_the_file_is_the_preset(cli: Cli, tmp_path: Path, preset: str) -> None:
    file = tmp_path / "mine.yaml"
    assert cli("init", file, "--from", preset).status == 0
    assert load_config(str(file)).config == load_config(preset).config


@pytest.mark.parametrize("preset", preset_names())
def test_what_is_commented_out_can_be_set(tmp_path: Path, preset: str) -> None:
    """With every # taken away all values of this kind of servo are set, to their defaults."""
    file = tmp_path / "mine.yaml"
    text = re.sub(r"^# (\w+:)$", r"\1", commented(preset), flags=re.M)
    file.write_text(re.sub(r"^  # (\w+: )", r"  \1", text, flags=re.M))
    mine, plain = load_config(str(file)), load_config(preset)
    assert mine.config == plain.config
    kind = plain.config.servo.kind
    given = {path for path in mine.given if not path.startswith("axes.")}
    assert given == {f.path for f in fields().values() if kind in f.used_by}


def test_a_file_that_is_there_is_kept(cli: Cli, tmp_path: Path) -> None:
    file = tmp_path / "mine.yaml"
    assert cli("init", file).status == 0
    held = file.read_text() + "# mine\n"
    file.write_text(held)
    assert "--force" in cli.refused("init", file)
    assert file.read_text() == held
    assert cli("init", file, "--force").status == 0
    assert file.read_text() != held


@pytest.mark.parametrize("preset", ["xm430-w350", "emulated-arm"])
def test_a_file_has_an_axis_for_each_id(cli: Cli, tmp_path: Path, preset: str) -> None:
    file = tmp_path / "arm.yaml"
    assert cli("init", file, "--axes", "3,1", "--from", preset).status == 0
    config = load_config(str(file)).config
    assert {name: one.servo.id for name, one in config.each.items()} == {"axis_3": 3, "axis_1": 1}
    assert (config.loop.rate_hz, config.wall.law, config.wall.position) == (500.0, "none", 0.0)


def test_a_preset_that_the_axes_do_not_fit_is_refused(cli: Cli, tmp_path: Path) -> None:
    told = cli.refused("init", tmp_path / "arm.yaml", "--axes", "1", "--from", "emulated-arm")
    assert "wall.low: found nothing" in told and "start --from another preset" in told


def test_the_pages_that_a_preset_names_are_there() -> None:
    root = Path(__file__).parents[2]
    texts = [preset_text(each) for each in preset_names()]
    named = {page for text in texts for page in re.findall(r"docs/\S+?\.md", text)}
    assert named and all((root / page).is_file() for page in named)
