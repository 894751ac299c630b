"""A commissioning's folder may come from anybody: what is read there is checked."""

import json
import os
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from tests.controller.experiments.commission.test_commission import (
    PNG,
    SIMULATED,
    call,
    report_of,
    steps_taken,
)

SECRET = b"root:x:0:0"


@pytest.fixture(scope="module")
def commissioned(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of a whole commissioning, in which one picture was drawn."""
    made = tmp_path_factory.mktemp("commission")
    with pytest.MonkeyPatch.context() as patch:
        steps_taken(patch, {"nothing": None})
        assert call("commission", *SIMULATED, "--out", made) == 0
    (made / "delay.png").write_bytes(PNG)
    edit(made, "delay", lambda outcome: outcome.update(picture="delay.png"))
    return made


@pytest.fixture
def folder(commissioned: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A copy of it; no step is taken, nothing is drawn."""
    steps_taken(monkeypatch, {"nothing": None})
    (tmp_path / "secret").write_bytes(SECRET)
    made = tmp_path / "made"
    shutil.copytree(commissioned, made)
    (made / "report.html").unlink()
    return made


def edit(folder: Path, step: str, change: Callable[[dict[str, Any]], object]) -> None:
    path = folder / f"{step}.json"
    outcome = json.loads(path.read_text())
    change(outcome)
    path.write_text(json.dumps(outcome))


def refused(folder: Path, capsys: pytest.CaptureFixture[str]) -> str:
    """The one sentence that it is refused with; there is no report then."""
    capsys.readouterr()
    assert call("commission", *SIMULATED, "--out", folder) == 2
    (line,) = [x for x in capsys.readouterr().err.splitlines() if x.startswith("haptic-wall: ")]
    assert not (folder / "report.html").exists()
    return line


def link(path: Path) -> None:
    path.symlink_to(path.parent.parent / "secret")


def too_long(path: Path) -> None:
    path.write_bytes(PNG)
    os.truncate(path, 2**24 + 1)


@pytest.mark.parametrize(
    ("make", "found"),
    [
        (link, "a link"),
        (os.mkfifo, "a pipe"),
        (lambda path: path.mkdir(), "a folder"),
        (too_long, "a longer one"),
        (lambda path: path.write_bytes(SECRET), "no PNG picture"),
        (lambda _path: None, "No such file"),
    ],
)
@pytest.mark.parametrize("name", ["delay.png", "delay.json", "commission.json"])
def test_only_plain_files_of_the_folder_are_read(
    folder: Path,
    capsys: pytest.CaptureFixture[str],
    name: str,
    make: Callable[[Path], object],
    found: str,
) -> None:
    path = folder / name
    path.unlink()
    make(path)
    if not path.is_symlink() and not path.exists() and path.suffix == ".json":
        return  # without it the step is taken again
    line = refused(folder, capsys)
    assert name in line
    assert found in line or path.suffix == ".json"


@pytest.mark.parametrize(
    ("step", "change"),
    [
        ("identify", lambda o: o.update(data=[])),
        ("identify", lambda o: o["data"].pop("inertia")),
        ("identify", lambda o: o["data"].update(inertia={"value": 0.0, "stderr": 0.1})),
        ("identify", lambda o: o["data"].update(delay={"value": float("inf"), "stderr": 1})),
        ("identify", lambda o: o["data"].update(config_text="servo: 7")),
        ("delay", lambda o: o["data"]["parts"].update(age=None)),
        ("rendered", lambda o: o["data"].update(rows=[{"name": "static stiffness"}])),
        ("sweep", lambda o: o["data"].update(points=[{"virtual_damping": 0.1}])),
        ("sweep", lambda o: o.update(step="delay")),
        ("sweep", lambda o: o.update(state="well")),
        ("sweep", lambda o: o.update(exit_status=256)),
    ],
)
def test_a_step_that_was_edited_is_checked_by_what_wrote_it(
    folder: Path,
    capsys: pytest.CaptureFixture[str],
    step: str,
    change: Callable[[dict[str, Any]], object],
) -> None:
    edit(folder, step, change)
    line = refused(folder, capsys)
    assert f"{step}.json" in line and "--fresh" in line


def test_an_identified_configuration_changes_nothing_but_the_model(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """A folder from somewhere must not raise a torque limit."""

    def stronger(outcome: dict[str, Any]) -> None:
        config = json.loads(outcome["data"]["config_text"])
        config["servo"]["torque_limit"] = 100.0
        outcome["data"]["config_text"] = json.dumps(config)

    before = (folder / "config.yaml").read_text()
    edit(folder, "identify", stronger)
    assert "differs from CONFIG" in refused(folder, capsys)
    assert (folder / "config.yaml").read_text() == before


def test_nothing_is_written_through_a_link(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    mine = folder.parent / "mine"
    mine.write_text("mine")
    for name in ("report.html", "report.html.part", "commission.json.part", "allowed.png"):
        (folder / name).unlink(missing_ok=True)
        (folder / name).symlink_to(mine)
    assert report_of(folder, capsys)[0] == 0
    assert mine.read_text() == "mine"
    assert (folder / "report.html").read_text().startswith("<!DOCTYPE html>")


@pytest.mark.parametrize("name", ["sweep", "logs"])
def test_no_folder_is_followed_out(
    folder: Path, capsys: pytest.CaptureFixture[str], name: str
) -> None:
    """A sweep somewhere else would be replaced."""
    if (folder / name).exists():
        shutil.rmtree(folder / name)
    (folder / name).symlink_to(folder.parent)
    assert f"found a link {name}" in refused(folder, capsys)


@pytest.mark.parametrize(
    "name", ["config.yaml", "report.html", "allowed.png", "delay.json", "delay.png", "sweep"]
)
def test_nothing_that_somebody_else_put_there_is_replaced(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], name: str
) -> None:
    """What delay or sweep wrote there, for instance."""
    (tmp_path / name).symlink_to("nowhere")
    for words in ((), ("--fresh",), ("--plan",)):
        assert call("commission", *SIMULATED, "--out", tmp_path, *words) == 2
        assert f"found a {name} that no commissioning wrote" in capsys.readouterr().err
    assert [path.name for path in tmp_path.iterdir()] == [name]


def test_what_comes_from_files_is_text_in_the_page(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    edit(folder, "doctor", lambda outcome: outcome.update(reason="<script>alert(1)</script>"))
    assert report_of(folder, capsys)[0] == 0
    page = (folder / "report.html").read_text()
    assert "<script>" not in page and "&lt;script&gt;" in page
