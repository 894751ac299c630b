"""The outcome of one step of a commissioning."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Literal

Step = Literal["doctor", "identify", "delay", "sweep"]
STEPS: tuple[Step, ...] = ("doctor", "identify", "delay", "sweep")
TITLES: Mapping[Step, str] = {
    "doctor": "the testbed examined",
    "identify": "inertia, friction and delay identified",
    "delay": "the loop's delay measured",
    "sweep": "the critical stiffness measured",
}

State = Literal["done", "failed", "skipped"]


@dataclass(frozen=True, slots=True)
class StepOutcome:
    """The outcome of one step, as it is kept."""

    step: Step
    state: State
    basis: str
    """Fingerprint of the step's configuration; with another one the step is repeated"""
    reason: str | None = None
    """Why it failed or was skipped; None: it is done"""
    exit_status: int = 0
    """Exit status of the command, if this is the first failed step"""
    ends_all: bool = False
    """No further step is possible with this servo now"""
    seconds: float = 0.0
    data: dict[str, Any] = field(default_factory=dict)


def partly_done(outcomes: Mapping[Step, StepOutcome], step: Step) -> dict[str, Any] | None:
    """Return a step's result, also of one that ended early; None if nothing was measured."""
    outcome = outcomes.get(step)
    return (outcome.data or None) if outcome is not None else None


def done(outcomes: Mapping[Step, StepOutcome], step: Step) -> dict[str, Any] | None:
    """Return a step's result; None if it is not done."""
    outcome = outcomes.get(step)
    return outcome.data if outcome is not None and outcome.state == "done" else None
