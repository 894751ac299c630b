"""Judges of trials, on made-up motions and on a few runs."""

from __future__ import annotations

import math

import numpy as np
import pytest
from numpy.typing import NDArray

from tests.support.cases_drawn import PRESETS
from tests.support.judges import (
    deadline_after,
    own_oscillation,
)
from tests.support.trial import Trial
from tests.support.truths_drawn import bench_of

BENCH = bench_of(PRESETS[0])
TIME = np.arange(8000) * 1e-3


def made_up(output: np.ndarray, state: int = 0, trip: str | None = None) -> Trial:
    """A trial with this true motion, at K 8."""
    n = output.size
    return Trial(
        period=1e-3,
        output=output,
        measured=output,
        torque=np.zeros(n),
        stiffness=np.full(n, 8.0),
        damping=np.zeros(n),
        held=np.zeros(n),
        state=np.full(n, state),
        saturated=np.zeros(n, dtype=np.bool_),
        first_alarm_s=math.nan,
        trip=trip,
        oscillation={},
    )


def swinging(
    growth: float = 0.0, amplitude: float = 0.1, seconds: float = 8.0
) -> NDArray[np.float64]:
    time = np.arange(float(round(seconds * 1e3))) * 1e-3
    return amplitude * np.exp(growth * time) * np.cos(math.tau * 5.0 * time)


def test_an_oscillation_must_decay_or_be_ended_before_its_deadline() -> None:
    goes_on = own_oscillation(made_up(swinging()), BENCH.belief)
    assert goes_on.onset_s == pytest.approx(0.1, abs=2e-3)
    assert goes_on.deadline_s == pytest.approx(0.1 + deadline_after(BENCH.belief, 8.0), abs=2e-3)
    assert goes_on.judged and not goes_on.in_time
    size = 0.1 * np.exp(np.where(TIME < 1.0, 0.5 * TIME, 0.5 - 0.3 * (TIME - 1.0)))
    decays = own_oscillation(made_up(size * np.cos(math.tau * 5.0 * TIME)), BENCH.belief)
    assert decays.decays_s == pytest.approx(1.0, abs=0.15)
    assert decays.in_time
    for seconds, wanted in ((1.0, True), (7.0, False)):
        ended = made_up(swinging(seconds=seconds), trip="oscillation")
        assert own_oscillation(ended, BENCH.belief).in_time is wanted
