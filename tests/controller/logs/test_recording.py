import math
from collections.abc import Iterable
from pathlib import Path

import numpy as np
import pytest

from haptic_wall.controller.errors import UserError
from haptic_wall.controller.logs import csv_recording
from haptic_wall.controller.logs.detected import read_recording
from haptic_wall.controller.theory.checks import FloatArray

RNG = np.random.default_rng(1)


def swing(times: FloatArray) -> FloatArray:
    return 0.05 * np.cos(math.tau * 5.0 * times)


def write(path: Path, **columns: Iterable[float]) -> Path:
    names = list(columns)
    lines = [",".join(names)]
    for row in zip(*columns.values(), strict=True):
        lines.append(",".join("" if math.isnan(value) else repr(float(value)) for value in row))
    path.write_text("\n".join(lines) + "\n")
    return path


def test_a_gap_parts_the_record_and_is_told(tmp_path: Path) -> None:
    times = np.arange(3000.0) * 1e-3
    times = times[(times < 1.0) | (times >= 1.5)]
    found = read_recording(write(tmp_path / "a.csv", time_s=times, position_rad=swing(times)))
    assert [part.times[0] for part in found.parts] == pytest.approx([0.0, 1.5])
    assert any("from 0.999 to 1.5 s" in note for note in found.notes)


def test_uneven_times_are_brought_onto_a_grid_and_told(tmp_path: Path) -> None:
    times = np.arange(3000.0) * 1e-3 + RNG.uniform(-4e-4, 4e-4, 3000)
    found = read_recording(write(tmp_path / "a.csv", time_s=times, position_rad=swing(times)))
    (part,) = found.parts
    assert found.period == pytest.approx(1e-3, rel=0.01)
    assert np.allclose(np.diff(part.times), found.period)
    # Interpolated over at most 1.8 ms: off by (w h)²/8 of the amplitude.
    assert (
        np.abs(part.positions - swing(part.times)).max() < 0.05 * (math.tau * 5 * 1.8e-3) ** 2 / 8
    )
    assert any("uneven" in note for note in found.notes)


def test_times_that_go_back_are_left_out_and_told(tmp_path: Path) -> None:
    times = np.arange(200.0) * 1e-3
    times[100] = 0.05
    times[150] = times[149]
    found = read_recording(write(tmp_path / "a.csv", time_s=times, position_rad=swing(times)))
    assert found.samples == 198
    assert any("2 rows are left out" in note and "0.05 s" in note for note in found.notes)


def test_a_csv_larger_than_what_fits_is_refused_at_once(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "a.csv"
    with path.open("wb") as file:
        file.truncate(1 << 40)
    with pytest.raises(UserError, match=f"found {1 << 40} bytes, wanted a CSV of at most"):
        read_recording(path)
    monkeypatch.setattr(csv_recording, "MOST_ROWS", 99)
    times = np.arange(100.0)
    with pytest.raises(UserError, match="found more than 99 rows"):
        read_recording(write(path, time_s=times, position_rad=times))


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "found nothing"),
        ("t,x\n0,1\n", "found t, x"),
        ("time_s,position_rad\n0,1\n0.001,one\n", "line 3, column position_rad: found 'one'"),
        ("time_s,position_rad\n0,1\n0.001,1\n", "found 2 rows"),
        ("time_s,position_rad\n" + "".join(f"{k},\n" for k in range(20)), "0 rows with a position"),
        ("time_s,position_rad\n" + "nan,1\n" * 20, "found 0 rows"),
        ('time_s,position_rad\n0,"' + 200_000 * "1", "line 2 has more than 65536 characters"),
    ],
)
def test_what_cannot_be_looked_at_is_refused_in_a_sentence(
    tmp_path: Path, text: str, message: str
) -> None:
    path = tmp_path / "a.csv"
    path.write_text(text)
    with pytest.raises(UserError, match=r"LOG .*a\.csv: ") as error:
        read_recording(path)
    assert message in str(error.value)


def test_units_that_are_hardly_s_and_rad_are_asked_for(tmp_path: Path) -> None:
    times = np.arange(100.0)
    path = write(tmp_path / "a.csv", time_s=times, position_rad=13.0 * np.cos(times))
    notes = " ".join(read_recording(path).notes)
    assert "milliseconds" in notes
    assert "degrees or encoder counts" in notes
