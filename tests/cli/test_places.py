"""No command writes over a file that is not its own, or beside another that writes there."""

import os
import subprocess
import sys
from pathlib import Path

import click
import pytest

from haptic_wall.controller.cli import main as program
from haptic_wall.controller.cli.places import take_folder
from haptic_wall.controller.logs.columns import COLUMNS
from haptic_wall.controller.system import file_kinds
from haptic_wall.controller.system.claim import claimed
from haptic_wall.controller.system.file_kinds import PICTURE, RECORD, may_be_replaced
from haptic_wall.controller.system.whole_file import whole
from haptic_wall.hw.emulated import witness
from tests.cli.caller import Cli

pytestmark = pytest.mark.usefixtures("undrawn")

SIMULATED = ["simulated", "--set=loop.clock=simulated"]
SWEEP = ["sweep", *SIMULATED, "--virtual-damping=0.1", "--delay-steps=0"]
BOUNDARY = ["boundary", "--servo=MX-64", "--rate=1000", "--delay=0.002"]
FOLDERS = [
    (["map", "simulated"], "map.json"),
    (["paper", "fig3"], "fig3.csv"),
    (["paper"], "index.html"),
    (["delay", *SIMULATED], "delay.json"),
    (["rendered", *SIMULATED], "rendered.png"),
    (SWEEP, "sweep.csv"),
    (SWEEP, "sweep.json"),
    ([*SWEEP, "--fresh"], "sweep.json"),
    (["commission", *SIMULATED], "report.html"),
    (["commission", *SIMULATED, "--fresh"], "identify.png"),
    (["commission", *SIMULATED], "sweep.png"),
]
FILES = [
    (["run", *SIMULATED], "--log"),
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


@pytest.mark.parametrize(("arguments", "name"), FOLDERS)
def test_a_folder_with_a_file_of_somebody_else_is_refused(
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
    with claimed(folder / "out"):
        assert "another run is writing" in cli.refused(*arguments, "--out", "link")
    assert not (folder / "out" / name).exists()


@pytest.mark.parametrize(("arguments", "option"), FILES)
def test_a_file_of_somebody_else_is_refused(
    cli: Cli, folder: Path, arguments: list[str], option: str
) -> None:
    (folder / "mine").write_text("mine")
    said = cli.refused(*arguments, option, "mine")
    assert f"{option} mine: found a file that is not" in said
    assert "--force" in said
    assert (folder / "mine").read_text() == "mine"
    assert [path.name for path in folder.iterdir()] == ["mine"]


@pytest.mark.parametrize(("arguments", "option"), FILES)
def test_a_file_that_another_command_writes_is_refused(
    cli: Cli, folder: Path, arguments: list[str], option: str
) -> None:
    (folder / "link").symlink_to("file")
    with claimed(folder / "file"):
        assert "another run is writing" in cli.refused(*arguments, option, "link")


def test_what_is_ours_is_known_by_its_beginning(folder: Path) -> None:
    assert may_be_replaced(folder / "nothing", PICTURE)
    path = folder / "file"
    path.write_text(witness.COLUMNS)
    assert may_be_replaced(path, RECORD)
    path.write_text(",".join(COLUMNS))
    assert may_be_replaced(path, file_kinds.table("time_s,position_rad,torque_nm,velocity"))
    assert not may_be_replaced(path, RECORD)
    path.write_text("")
    assert may_be_replaced(path, RECORD), "nothing is in it"
    path.unlink()
    path.symlink_to("/dev/null")
    assert not may_be_replaced(path, RECORD), "a device is written to, not replaced"


def test_links_in_a_circle_are_told_in_a_sentence(cli: Cli, folder: Path) -> None:
    (folder / "one").symlink_to("other")
    (folder / "other").symlink_to("one")
    for arguments, option in FILES:
        said = cli.refused(*arguments, option, "one")
        assert f"{option} one: its links lead in a circle; name another place" in said


def test_what_a_killed_command_left_beside_its_file_is_removed(folder: Path) -> None:
    ended = subprocess.Popen([sys.executable, "-c", ""])
    ended.wait()
    stale = folder / f".b.png.{ended.pid}.part"
    others = [
        folder / f".b.png.{os.getppid()}.part",  # its process is there
        folder / f".other.png.{ended.pid}.part",
        folder / f".b.png.{ended.pid}.part.bak",
    ]
    for path in (stale, *others):
        path.write_text("half")
    assert program.main([*BOUNDARY, "--plot", "b.png", "--virtual-damping=0.1"]) == 0
    assert not stale.exists()
    assert all(path.read_text() == "half" for path in others)


def test_a_link_that_somebody_put_where_a_file_is_written_is_not_followed(folder: Path) -> None:
    (folder / "mine").write_text("mine")
    with whole(folder / "b.png", PICTURE) as part:
        name = part.name
    (folder / name).symlink_to("mine")
    with whole(folder / "b.png", PICTURE, force=True) as part:
        assert not part.is_symlink()
        part.write_text("picture")
    assert (folder / "b.png").read_text() == "picture"
    assert (folder / "mine").read_text() == "mine"


def command() -> click.Context:
    return click.Context(click.Command("one"))


def test_only_the_folders_that_the_command_has_made_are_removed(folder: Path) -> None:
    (folder / "given").mkdir()
    with command():
        for name in ("given", "new/out", "new/full"):
            take_folder("--out", Path(name), {}, force=False)
        (folder / "new" / "full" / "mine").mkdir()
    assert sorted(str(path.relative_to(folder)) for path in folder.rglob("*")) == [
        *("given", "new", "new/full", "new/full/mine")
    ]
