"""Quantities that the tests of trials need beyond a trial's report."""

from __future__ import annotations

import math
from dataclasses import replace

from scripts.trials.judges import SMALL_COUNTS, ending
from scripts.trials.operators import NOTHING, ROW_NS, Operator
from scripts.trials.run import Trial
from scripts.trials.truth import Truth


def called_quiet(trial: Trial, *, counts_per_rev: int = 4096) -> bool:
    """Whether a motion above four counts sustains itself at the end and is quiet or decaying."""
    end = ending(trial, 2.0, counts_per_rev=counts_per_rev)
    return end.amplitude > SMALL_COUNTS * math.tau / counts_per_rev and end.quiet > 0.5


def released(operator: Operator, time_s: float) -> Operator:
    """The same operator, letting go at ``time_s`` [s]."""
    return replace(operator, rows=operator.rows[: max(0, round(time_s * 1e9 / operator.row_ns))])


def kick(torque: float, duration_s: float, after_s: float = 0.0) -> Operator:
    """A push with a torque [N·m] that begins after a while, and then nobody."""
    before, during = round(after_s * 1e9 / ROW_NS), round(duration_s * 1e9 / ROW_NS)
    return Operator([NOTHING] * before + [(0.0, 0.0, 0.0, 0.0, torque)] * during, name="kick")


def mode_hz(truth: Truth) -> float:
    """Natural frequency of the transmission, both ends free [Hz]; NaN for a rigid servo."""
    if not truth.flexible:
        return math.nan
    motor = truth.inertia - truth.load_inertia
    reduced = motor * truth.load_inertia / truth.inertia
    return math.sqrt(truth.transmission_stiffness / reduced) / math.tau
