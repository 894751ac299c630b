"""The ceiling of the virtual damping, from cruises whose vibration grows with the damping."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from haptic_wall.controller.experiments.sweep.ceiling import CeilingSearch
from haptic_wall.controller.experiments.sweep.vibration_growth import (
    Cruised,
    growth_of,
    ringing_hz,
)
from haptic_wall.controller.experiments.testbed import ExperimentTrippedError, Testbed
from haptic_wall.controller.laws.program import Phase
from haptic_wall.controller.runtime.safety import Trip
from haptic_wall.controller.settings.load import load_config
from haptic_wall.controller.theory.checks import FloatArray
from tests.typed import not_none

COUNT = math.tau / 4096
HERTZ = 41.0


def cruise(growth: float, amplitude: float, way: float = 1.0) -> tuple[FloatArray, FloatArray]:
    time = 1e-3 * np.arange(400, dtype=np.float64)
    ringing = amplitude * np.exp(growth * time) * np.sin(math.tau * HERTZ * time + 0.3)
    position = way * (1.4 * time + 0.2 * time**2) + ringing
    return time, np.round(position / COUNT) * COUNT


@pytest.mark.parametrize("growth", [-6.0, 0.0, 5.0])
def test_growth_is_told_within_its_error(growth: float) -> None:
    cruises = [Cruised(*cruise(growth, 2.5e-3, way), way, COUNT) for way in (1.0, -1.0)]
    hertz = ringing_hz(cruises)
    found = growth_of(cruises, hertz)
    assert found is not None
    assert abs(found.per_s - growth) <= 2.0 * found.stderr
    assert found.stderr < 1.0
    assert found.hertz == pytest.approx(HERTZ, rel=0.005)


def test_no_vibration_has_no_growth() -> None:
    assert growth_of([Cruised(*cruise(0.0, 0.0), 1.0, COUNT)], HERTZ) is None


class Bed:
    """Plays cruises whose vibration grows in proportion to the damping beyond a ceiling."""

    def __init__(self, ceiling: float, *sets: str) -> None:
        chosen = ["loop.clock=simulated", "servo.hand=none", "servo.delay=0.001", *sets]
        self.config = load_config("simulated", chosen).config
        self.ceiling = ceiling
        self.folder = Path()

    def play(self, name: str, phases: Sequence[Phase], delay_steps: int) -> Any:
        del name, delay_steps
        fields = [("outcome", "u1"), ("phase", "i4"), ("sampled_ns", "i8"), ("position", "f8")]
        parts = []
        for number, phase in enumerate(phases):
            if phase.damping:
                growth = min(20.0 * (phase.damping / self.ceiling - 1.0), 9.0)
                time, position = cruise(growth, 2.5e-3, math.copysign(1.0, phase.bias))
                rows = np.zeros(time.size, fields)
                rows["phase"], rows["position"] = number, position
                rows["sampled_ns"] = np.rint(1e9 * time)
                parts.append(rows)
        return SimpleNamespace(rows=np.concatenate(parts))


def searched(bed: Bed) -> CeilingSearch:
    return CeilingSearch(cast("Testbed", bed), 0)


@pytest.mark.whole
def test_the_ceiling_is_found_without_knowing_of_a_vibration() -> None:
    result = searched(Bed(0.13)).run()
    assert result.measured == pytest.approx(0.13, rel=0.02)
    assert abs(not_none(result.measured) - 0.13) < 3.0 * not_none(result.uncertainty)
    assert result.frequency_hz == pytest.approx(HERTZ, rel=0.01)
    assert result.exact == result.rigid > 1.0


@pytest.mark.whole
def test_a_ceiling_out_of_reach_leaves_a_lower_bound() -> None:
    search = searched(Bed(50.0))
    result = search.run()
    assert result.measured is None
    assert result.at_least == pytest.approx(search.top)
    assert "the servo does not vibrate up to" in (result.reason or "")


@pytest.mark.whole
def test_the_believed_vibration_is_where_it_starts() -> None:
    believed = ("model.load_inertia=0.003", "model.inertia=0.015", "model.flexible_hz=41",
                "model.flexible_damping_ratio=0.02")  # fmt: skip
    result = searched(Bed(0.13, *believed)).run()
    assert result.exact < 0.1 * result.rigid
    assert min(t.virtual_damping for t in result.trials) > 0.03
    assert result.measured == pytest.approx(0.13, rel=0.02)


def test_friction_beyond_a_cruises_torque_is_the_reason() -> None:
    search = searched(Bed(0.13, "servo.coulomb=2.5"))
    result = search.run()
    assert search.top < 0.0
    assert (result.measured, result.trials, result.logs) == (None, [], [])
    assert "and a cruise may use" in (result.reason or "")


def test_a_trip_without_a_growing_vibration_is_the_reason() -> None:
    class Tripping(Bed):
        def play(self, name: str, phases: Sequence[Phase], delay_steps: int) -> Any:
            del name, phases, delay_steps
            raise ExperimentTrippedError(Trip.OVERSPEED, "6.1 rad/s, the limit is 5")

    result = searched(Tripping(0.13)).run()
    assert (result.measured, result.trials, result.at_least) == (None, [], None)
    assert "no vibration was seen to grow" in (result.reason or "")
    assert "6.1 rad/s, the limit is 5" in (result.reason or "")
