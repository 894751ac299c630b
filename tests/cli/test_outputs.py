"""Where log and picture of a run go, and what is said of a long one."""

from pathlib import Path

import pytest

from haptic_wall.controller.cli import main as cli
from tests.typed import status_of

BRIEF = ["--set=loop.clock=simulated", "--duration=0.05"]


def run(*arguments: str) -> int:
    """A brief run; its exit status."""
    with pytest.raises(SystemExit) as ended:
        cli.main(["run", *BRIEF, *arguments])
    return status_of(ended.value)


@pytest.mark.parametrize(
    ("log", "picture"), [("a.hwlog", "a.png"), ("a", "a.png"), ("a.b", "a.b.png")]
)
def test_the_picture_goes_beside_an_explicit_log(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    log: str,
    picture: str,
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(
        "haptic_wall.controller.report.run.plot_log", lambda _rows, path, **_: path.touch()
    )
    assert run("--log", log) == 0
    assert {each.name for each in tmp_path.iterdir()} == {log, picture}
    assert f"picture     {picture}" in capsys.readouterr().out


def test_a_foreign_picture_beside_the_log_is_kept(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "a.png").write_text("mine")
    assert cli.main(["run", *BRIEF, "--log", "a.hwlog"]) == 2
    assert "--plot a.png" in capsys.readouterr().err
    assert (tmp_path / "a.png").read_text() == "mine"
