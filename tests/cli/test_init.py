"""``init`` writes a preset with what else can be set, and keeps what is there."""

import re
from pathlib import Path

import pytest

from haptic_wall.controller.cli import main as cli
from haptic_wall.controller.cli.init import commented
from haptic_wall.controller.settings.fields import fields
from haptic_wall.controller.settings.load import load_config, preset_names


@pytest.mark.parametrize("preset", preset_names())
def test_the_file_is_the_preset(tmp_path: Path, preset: str) -> None:
    file = tmp_path / "mine.yaml"
    assert cli.main(["init", str(file), "--from", preset]) == 0
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
    assert set(mine.origins) == {f.path for f in fields().values() if kind in f.used_by}


def test_a_file_that_is_there_is_kept(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file = tmp_path / "mine.yaml"
    assert cli.main(["init", str(file)]) == 0
    held = file.read_text() + "# mine\n"
    file.write_text(held)
    assert cli.main(["init", str(file)]) == 2
    assert "--force" in capsys.readouterr().err
    assert file.read_text() == held
    assert cli.main(["init", str(file), "--force"]) == 0
    assert file.read_text() != held


def test_a_presets_name_is_refused_because_config_would_mean_the_preset(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    assert cli.main(["init", "simulated"]) == 2
    assert "--from simulated" in capsys.readouterr().err
    assert not list(tmp_path.iterdir())
