"""``paper`` writes what it says, and says what is wrong with what it was asked."""

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from matplotlib.figure import Figure
from numpy.typing import NDArray

from haptic_wall.controller.cli import main as cli
from haptic_wall.controller.theory import critical_stiffness


@pytest.fixture
def call(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> Callable[..., tuple[int, str, str]]:
    def simulated(
        virtual_damping: NDArray[np.float64], delay: NDArray[np.float64]
    ) -> NDArray[np.float64]:
        return 1.00001 * critical_stiffness(1.0, 0.1, virtual_damping, 1e-3, delay)

    monkeypatch.setattr("haptic_wall.controller.paper.table2._simulate", simulated)

    def run(*arguments: str | Path) -> tuple[int, str, str]:
        status = cli.main(["paper", *map(str, arguments)])
        captured = capsys.readouterr()
        return status, captured.out, captured.err

    return run


def test_one_item_is_a_table_and_a_picture(
    call: Callable[..., tuple[int, str, str]], tmp_path: Path
) -> None:
    status, out, err = call("fig4", "--out", tmp_path / "new" / "folder")
    assert status == 0
    files = sorted(path.name for path in (tmp_path / "new" / "folder").iterdir())
    assert files == ["fig4.csv", "fig4.png"]
    assert all(str(tmp_path / "new" / "folder" / name) in out for name in files)
    assert "fig4" in err
    assert call("fig4", "--out", tmp_path / "new" / "folder")[0] == 2, "they would be lost"
    assert call("fig4", "--out", tmp_path / "new" / "folder", "--force")[0] == 0


@pytest.mark.whole
def test_everything_is_the_default(
    call: Callable[..., tuple[int, str, str]], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    # What is drawn has tests of its own; it takes seconds.
    monkeypatch.setattr(Figure, "savefig", lambda _figure, path, **_: path.touch())
    status, out, _ = call("--out", tmp_path, "--json")
    assert status == 0
    report = json.loads(out)
    files = {str(path) for path in tmp_path.iterdir()}
    assert set(report["files"]) == files
    assert len(files) == 2 * 8
    assert abs(report["table2"]["theory"]["error_percent"]) < 0.05
    assert report["table2"]["simulation"]["delay_samples"] == 0


def test_a_wrong_item_is_named_with_what_there_is(
    call: Callable[..., tuple[int, str, str]], tmp_path: Path
) -> None:
    status, out, err = call("tabel2", "--out", tmp_path)
    assert (status, out) == (2, "")
    assert "ITEM: 'tabel2' is not one of 'table2', 'fig3'" in err
    assert list(tmp_path.iterdir()) == []
    assert "--out: missing" in call("fig8")[2]
