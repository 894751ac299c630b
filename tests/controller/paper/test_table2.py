"""Table II: theory and simulation meet the printed value in every cell."""

import csv
from pathlib import Path

import numpy as np
import pytest

from haptic_wall.controller.paper import table2
from haptic_wall.controller.theory import critical_stiffness
from haptic_wall.controller.theory.checks import FloatArray


def some_simulated(virtual_damping: FloatArray, delay: FloatArray) -> FloatArray:
    """A simulation of a cell of three columns; theory stands in for the others."""
    damping, late = (each.ravel() for each in np.broadcast_arrays(virtual_damping, delay))
    found = np.array(critical_stiffness(1.0, 0.1, damping, 1e-3, late))
    found[::13] = SIMULATE(damping[::13], late[::13])
    return found.reshape(9, 4)


SIMULATE = table2._simulate


@pytest.fixture(scope="module")
def table(wholly: bool) -> table2.Table2:
    with pytest.MonkeyPatch.context() as patch:
        if not wholly:
            patch.setattr(table2, "_simulate", some_simulated)
        return table2.compare()


def test_all_cells_are_there(table: table2.Table2) -> None:
    assert table.delay_samples.tolist() == [0, 0.25, 0.5, 0.75, 1, 1.5, 2, 3, 4]
    assert table.virtual_damping.tolist() == [0.1, 0.2, 0.3, 0.4]
    assert table.printed.shape == table.theory.shape == table.simulation.shape == (9, 4)
    assert (table.printed[0, 0], table.printed[-1, -1]) == (399.89, 111.03)


def test_theory_and_simulation_are_near_to_print_and_much_nearer_to_each_other(
    table: table2.Table2,
) -> None:
    assert np.abs(table.error_percent("theory")).max() < 0.05
    assert np.abs(table.error_percent("simulation")).max() < 0.1
    np.testing.assert_allclose(table.simulation, table.theory, rtol=1e-5)


def off_by_a_percent(virtual_damping: FloatArray, delay: FloatArray) -> FloatArray:
    """A simulation that is wrong in one cell."""
    stiffness = critical_stiffness(1.0, 0.1, virtual_damping, 1e-3, delay)
    return stiffness * np.where((delay == 2e-3) & (virtual_damping == 0.3), 0.99, 1.0)


def test_the_worst_cell_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(table2, "_simulate", off_by_a_percent)
    table = table2.compare()
    worst = table.worst("simulation")
    assert (worst["delay_samples"], worst["virtual_damping"]) == (2.0, 0.3)
    assert worst["error_percent"] == pytest.approx(-1.0, abs=0.05)
    text = table2.text(table)
    assert "worst by simulation: -0.99" in text
    assert "t_d/T = 2, B = 0.3" in text
    assert len([line for line in text.splitlines() if "399.89" in line]) == 3


def test_csv_holds_every_cell_with_its_errors(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(table2, "_simulate", off_by_a_percent)
    table = table2.compare()
    table2.write_csv(table, tmp_path / "table2.csv")
    with (tmp_path / "table2.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == 36
    for row in rows:
        printed = float(row["printed_n_per_m"])
        for source in ("theory", "simulation"):
            error = 100 * (float(row[f"{source}_n_per_m"]) - printed) / printed
            assert float(row[f"{source}_error_percent"]) == pytest.approx(error, abs=1e-9)
