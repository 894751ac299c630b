"""Rows survive the trip through shared memory; a slow reader loses rows, never gets wrong ones."""

from typing import Any

import numpy as np
import pytest

from haptic_wall.controller.runtime.telemetry import (
    CAPACITY,
    FLOAT_FIELDS,
    INT_FIELDS,
    ROW,
    Telemetry,
)

VALUES = [*range(1, len(INT_FIELDS)), *(0.5 + k for k in range(len(FLOAT_FIELDS)))]


def test_what_is_written_is_read() -> None:
    telemetry = Telemetry.create()
    telemetry.write(*VALUES)
    rows, tail = telemetry.read(0)
    assert tail == 1
    assert list(rows[0, 0].tolist()) == [0, *VALUES]
    rows, tail = telemetry.read(tail)
    assert rows.size == 0
    assert tail == 1


def test_a_tick_is_read_when_all_axes_have_written() -> None:
    telemetry = Telemetry.create(3)
    for k in range(8):
        telemetry.write(k, *VALUES[1:])
    rows, tail = Telemetry(telemetry.descriptor, axes=3).read(0)
    assert tail == 2
    assert rows["deadline_ns"].tolist() == [[0, 1, 2], [3, 4, 5]]
    assert rows["seq"].tolist() == [[0, 0, 0], [1, 1, 1]]


def test_an_overtaken_reader_gets_the_newest_rows_and_sees_the_gap() -> None:
    telemetry = Telemetry.create()
    total = CAPACITY + 500
    for k in range(total):
        telemetry.write(k, *VALUES[1:])
    rows, tail = telemetry.read(0)
    assert tail == total
    assert rows.dtype == ROW
    np.testing.assert_array_equal(rows["seq"][:, 0], np.arange(total - CAPACITY + 1, total))
    np.testing.assert_array_equal(rows["deadline_ns"], rows["seq"])


def test_rows_that_are_overwritten_while_they_are_read_are_left_out(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    telemetry = Telemetry.create()
    for k in range(CAPACITY):
        telemetry.write(k, *VALUES[1:])
    plain = telemetry._rows

    class Overtaken:
        """The writer comes by in the middle of the copy."""

        def __getitem__(self, places: Any) -> Any:
            copy = plain[places].copy()
            rows = copy.reshape(-1).view(ROW)
            rows[:10]["position"] = -1.0  # torn: the sequence number is still the old one
            for k in range(10 if rows.size else 0):
                telemetry.write(k, *VALUES[1:])
            return copy

    monkeypatch.setattr(telemetry, "_rows", Overtaken())
    rows, tail = telemetry.read(0)
    assert tail == CAPACITY
    assert not np.any(rows["position"] == -1.0)
    assert rows["seq"][-1, 0] == CAPACITY - 1
    assert rows.size == CAPACITY - 11
