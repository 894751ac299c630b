"""``paper`` writes what it says, and says what is wrong with what it was asked."""

from pathlib import Path

import numpy as np
import pytest
from matplotlib.figure import Figure
from numpy.typing import NDArray

from haptic_wall.controller.theory import critical_stiffness
from tests.support.program import Cli


@pytest.fixture(autouse=True)
def simulated(monkeypatch: pytest.MonkeyPatch) -> None:
    def simulate(
        virtual_damping: NDArray[np.float64], delay: NDArray[np.float64]
    ) -> NDArray[np.float64]:
        return 1.00001 * critical_stiffness(1.0, 0.1, virtual_damping, 1e-3, delay)

    monkeypatch.setattr("haptic_wall.controller.paper.table2._simulate", simulate)


def test_one_item_is_a_table_and_a_picture(cli: Cli, tmp_path: Path) -> None:
    folder = tmp_path / "new" / "folder"
    status, out, err = cli("paper", "fig4", "--out", folder)
    assert status == 0
    files = sorted(path.name for path in folder.iterdir())
    assert files == ["fig4.csv", "fig4.png"]
    assert all(str(folder / name) in out for name in files)
    assert "fig4" in err
    assert cli("paper", "fig4", "--out", folder, "--force").status == 0


@pytest.mark.whole
def test_everything_is_the_default(
    cli: Cli, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    # What is drawn has tests of its own; it takes seconds.
    monkeypatch.setattr(Figure, "savefig", lambda _figure, path, **_: path.touch())
    report = cli.json("paper", "--out", tmp_path)
    files = {str(path) for path in tmp_path.iterdir()}
    assert set(report["files"]) == files
    assert len(files) == 2 * 8
    assert abs(report["table2"]["theory"]["error_percent"]) < 0.05
    assert report["table2"]["simulation"]["delay_samples"] == 0
