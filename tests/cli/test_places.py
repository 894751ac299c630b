"""No command writes over a file unasked, or beside another command that writes there."""

from pathlib import Path

import click
import pytest

from haptic_wall.controller.cli.places import take_folder
from tests.support.program import Cli

pytestmark = pytest.mark.usefixtures("undrawn")

SIMULATED = ["simulated", "--set=loop.clock=simulated"]
SWEEP = ["sweep", *SIMULATED, "--virtual-damping=0.1", "--delay-steps=0"]
BOUNDARY = ["boundary", "--servo=MX-64", "--period=0.001", "--delay=0.002"]
FOLDERS = [
    (["paper", "fig3"], "fig3.csv"),
    (["delay", *SIMULATED], "delay.json"),
    (SWEEP, "sweep.csv"),
    (["commission", *SIMULATED], "report.txt"),
    (["commission", *SIMULATED], "config.yaml"),
    (["acceptance", *SIMULATED], "acceptance.json"),
]
FILES = [
    (["run", *SIMULATED], "--log"),
    (["run", *SIMULATED], "--plot"),
    (["run", "emulated-ideal"], "--witness"),
    (["identify", *SIMULATED], "--out"),
    (["identify", *SIMULATED], "--plot"),
    (BOUNDARY, "--plot"),
    (["emulate"], "--record"),
]


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    return tmp_path


def command() -> click.Context:
    return click.Context(click.Command("one"))


@pytest.mark.parametrize(("arguments", "name"), FOLDERS)
def test_a_folder_with_a_file_of_that_name_is_refused(
    cli: Cli, folder: Path, arguments: list[str], name: str
) -> None:
    (folder / "out").mkdir()
    mine = folder / "out" / name
    mine.write_text("mine")
    assert name in cli.refused(*arguments, "--out", "out")
    assert [path.name for path in mine.parent.iterdir()] == [name]
    assert mine.read_text() == "mine"


@pytest.mark.parametrize(("arguments", "name"), FOLDERS)
def test_a_folder_that_another_command_writes_to_is_refused(
    cli: Cli, folder: Path, arguments: list[str], name: str
) -> None:
    (folder / "out").mkdir()
    (folder / "link").symlink_to("out")
    with command():
        take_folder("--out", folder / "out", ())
        assert "another command is writing" in cli.refused(*arguments, "--out", "link")
    assert not (folder / "out" / name).exists()


@pytest.mark.parametrize(("arguments", "option"), FILES)
def test_a_file_that_is_there_is_refused(
    cli: Cli, folder: Path, arguments: list[str], option: str
) -> None:
    (folder / "mine").write_text("mine")
    said = cli.refused(*arguments, option, "mine")
    assert f"{option} mine: found a file, which would be lost" in said
    assert "--force" in said
    assert (folder / "mine").read_text() == "mine"
    assert [path.name for path in folder.iterdir()] == ["mine"]


def test_only_folders_that_were_made_are_removed_at_the_end(folder: Path) -> None:
    with command():
        take_folder("--out", folder / "new" / "out", ())
    assert not (folder / "new").exists()
    with command():
        take_folder("--out", folder / "new" / "out", ())
        (folder / "new" / "out" / "mine").mkdir()
    assert (folder / "new" / "out" / "mine").is_dir()
