"""No command writes over a file that is not its own, or beside another that writes there."""

import pytest

from controller import file_kinds
from controller.claim import claimed
from controller.cli import main as cli
from controller.file_kinds import PICTURE, RECORD, may_be_replaced
from controller.log.columns import COLUMNS
from hw.dynamixel.emulated import witness

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
    ([*SWEEP, "--fresh"], "sweep.json"),
    (["commission", *SIMULATED], "report.html"),
    (["commission", *SIMULATED, "--fresh"], "identify.json"),
    (["commission", *SIMULATED], "sweep.png"),
]
FILES = [
    (["run", *SIMULATED], "--log"),
    (["run", "emulated-xm430"], "--witness"),
    (["identify", *SIMULATED], "--out"),
    (["identify", *SIMULATED], "--plot"),
    (BOUNDARY, "--plot"),
    (["bench", "--section=detector"], "--html"),
    (["emulate"], "--record"),
]


def refused(capsys, arguments):
    """What is said to a command that must not begin."""
    assert cli.main([*map(str, arguments)]) == 2
    captured = capsys.readouterr()
    assert captured.out == ""
    return captured.err


@pytest.fixture(autouse=True)
def folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.mark.parametrize(("arguments", "name"), FOLDERS)
def test_a_folder_with_a_file_of_somebody_else_is_refused(capsys, folder, arguments, name):
    (folder / "out").mkdir()
    mine = folder / "out" / name
    mine.write_text("mine")
    assert name in refused(capsys, [*arguments, "--out", "out"])
    assert [path.name for path in mine.parent.iterdir()] == [name]
    assert mine.read_text() == "mine"


@pytest.mark.parametrize(("arguments", "name"), FOLDERS)
def test_a_folder_that_another_command_writes_to_is_refused(capsys, folder, arguments, name):
    (folder / "out").mkdir()
    (folder / "link").symlink_to("out")
    with claimed(folder / "out"):
        assert "another run is writing" in refused(capsys, [*arguments, "--out", "link"])
    assert not (folder / "out" / name).exists()


@pytest.mark.parametrize(("arguments", "option"), FILES)
def test_a_file_of_somebody_else_is_refused(capsys, folder, arguments, option):
    (folder / "mine").write_text("mine")
    said = refused(capsys, [*arguments, option, "mine"])
    assert f"{option} mine: found a file that is not" in said
    assert "--force" in said
    assert (folder / "mine").read_text() == "mine"
    assert [path.name for path in folder.iterdir()] == ["mine"]


@pytest.mark.parametrize(("arguments", "option"), FILES)
def test_a_file_that_another_command_writes_is_refused(capsys, folder, arguments, option):
    (folder / "link").symlink_to("file")
    with claimed(folder / "file"):
        assert "another run is writing" in refused(capsys, [*arguments, option, "link"])


def test_what_is_ours_is_known_by_its_beginning(folder):
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


def test_links_in_a_circle_are_told_in_a_sentence(capsys, folder):
    (folder / "one").symlink_to("other")
    (folder / "other").symlink_to("one")
    for arguments, option in FILES:
        said = refused(capsys, [*arguments, option, "one"])
        assert f"{option} one: its links lead in a circle; name another place" in said
