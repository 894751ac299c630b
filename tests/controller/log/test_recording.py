import math

import numpy as np
import pytest

from controller.errors import UserError
from controller.log.recordings import read_recordings

STEP = math.tau / 4096
RNG = np.random.default_rng(1)


def read_recording(path):
    (found,) = read_recordings(path)
    return found


def swing(times):
    return 0.05 * np.cos(math.tau * 5.0 * times)


def write(path, **columns):
    names = list(columns)
    lines = [",".join(names)]
    for row in zip(*columns.values(), strict=True):
        lines.append(",".join("" if math.isnan(value) else repr(float(value)) for value in row))
    path.write_text("\n".join(lines) + "\n")
    return path


def test_an_even_record_is_taken_as_it_is(tmp_path):
    times = np.arange(2000) * 1e-3
    counted = np.round(swing(times) / STEP) * STEP
    path = write(tmp_path / "a.csv", time_s=times, position_rad=counted, torque_nm=-counted)
    found = read_recording(path)
    assert found.period == pytest.approx(1e-3)
    assert found.notes == ()
    (part,) = found.parts
    assert np.array_equal(part.positions, counted)
    assert np.array_equal(part.torques, -counted)
    assert found.known.position_step == pytest.approx(STEP, rel=1e-9)


def test_columns_may_come_in_any_order_with_others_beside(tmp_path):
    times = np.arange(100) * 1e-3
    path = write(tmp_path / "a.csv", extra=times, position_rad=swing(times), time_s=times)
    found = read_recording(path)
    assert np.allclose(found.parts[0].positions, swing(times))
    assert any("no column torque_nm" in note for note in found.notes)
    assert found.known.position_step == 0.0


def test_a_gap_parts_the_record_and_is_told(tmp_path):
    times = np.arange(3000) * 1e-3
    times = times[(times < 1.0) | (times >= 1.5)]
    found = read_recording(write(tmp_path / "a.csv", time_s=times, position_rad=swing(times)))
    assert [part.times[0] for part in found.parts] == pytest.approx([0.0, 1.5])
    assert any("from 0.999 to 1.5 s" in note for note in found.notes)


def test_missing_positions_stay_missing(tmp_path):
    times = np.arange(1000) * 1e-3
    positions = swing(times)
    positions[[10, 500, 501]] = math.nan
    found = read_recording(write(tmp_path / "a.csv", time_s=times, position_rad=positions))
    (part,) = found.parts
    assert np.count_nonzero(np.isnan(part.positions)) == 3
    assert any("3 rows have no position, first at 0.01 s" in note for note in found.notes)


def test_missing_torques_are_held_and_told(tmp_path):
    times = np.arange(100) * 1e-3
    torques = np.full(100, 2.0)
    torques[[0, 50]] = math.nan
    path = write(tmp_path / "a.csv", time_s=times, position_rad=times, torque_nm=torques)
    found = read_recording(path)
    assert found.parts[0].torques[0] == 0.0
    assert found.parts[0].torques[50] == 2.0
    assert any("2 rows have no torque" in note for note in found.notes)


def test_uneven_times_are_brought_onto_a_grid_and_told(tmp_path):
    times = np.arange(3000) * 1e-3 + RNG.uniform(-4e-4, 4e-4, 3000)
    found = read_recording(write(tmp_path / "a.csv", time_s=times, position_rad=swing(times)))
    (part,) = found.parts
    assert found.period == pytest.approx(1e-3, rel=0.01)
    assert np.allclose(np.diff(part.times), found.period)
    # Interpolated over at most 1.8 ms: off by (w h)²/8 of the amplitude.
    assert (
        np.abs(part.positions - swing(part.times)).max() < 0.05 * (math.tau * 5 * 1.8e-3) ** 2 / 8
    )
    assert any("uneven" in note for note in found.notes)


def test_samples_that_come_in_pairs_have_no_usual_step_and_are_told(tmp_path):
    times = np.concatenate([[0.0], np.cumsum(np.tile([0.3e-3, 1.7e-3], 1500))])
    found = read_recording(write(tmp_path / "a.csv", time_s=times, position_rad=swing(times)))
    assert found.period == pytest.approx(1e-3, rel=0.01)
    assert any("uneven" in note for note in found.notes)


def test_times_that_go_back_are_left_out_and_told(tmp_path):
    times = np.arange(200) * 1e-3
    times[100] = 0.05
    times[150] = times[149]
    found = read_recording(write(tmp_path / "a.csv", time_s=times, position_rad=swing(times)))
    assert found.samples == 198
    assert any("2 rows are left out" in note and "0.05 s" in note for note in found.notes)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "found nothing"),
        ("t,x\n0,1\n", "found t, x"),
        ("time_s,position_rad\n0,1\n0.001,one\n", "line 3, column position_rad: found 'one'"),
        ("time_s,position_rad\n0,1\n0.001,1\n", "found 2 rows"),
        ("time_s,position_rad\n" + "".join(f"{k},\n" for k in range(20)), "0 rows with a position"),
        ("time_s,position_rad\n" + "nan,1\n" * 20, "found 0 rows"),
        ('time_s,position_rad\n0,"' + 200_000 * "1", "is a quote left open?"),
    ],
)
def test_what_cannot_be_looked_at_is_refused_in_a_sentence(tmp_path, text, message):
    path = tmp_path / "a.csv"
    path.write_text(text)
    with pytest.raises(UserError, match=r"LOG .*a\.csv: ") as error:
        read_recording(path)
    assert message in str(error.value)


def test_any_bytes_are_refused_or_read_but_never_a_traceback(tmp_path):
    path = tmp_path / "a.csv"
    for size in (1, 10, 1000):
        path.write_bytes(b"time_s,position_rad\n" + RNG.bytes(size))
        with pytest.raises(UserError):
            read_recording(path)
