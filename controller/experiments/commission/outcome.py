"""The outcome of one step of a commissioning."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Annotated, Any, Literal

from pydantic import Field

Step = Literal["doctor", "identify", "delay", "rendered", "sweep"]
STEPS: tuple[Step, ...] = ("doctor", "identify", "delay", "rendered", "sweep")
TITLES: Mapping[Step, str] = {
    "doctor": "the testbed examined",
    "identify": "inertia, friction and delay identified",
    "delay": "the loop's delay measured",
    "rendered": "rendered and commanded wall compared",
    "sweep": "the critical stiffness measured",
}

State = Literal["done", "failed", "skipped"]


@dataclass(frozen=True, slots=True)
class StepOutcome:
    """The outcome of one step, as its JSON file stores it."""

    step: Step
    state: State
    basis: str
    """Fingerprint of the step's configuration; with another one the step is repeated"""
    reason: str | None = None
    """Why it failed or was skipped; None: it is done"""
    exit_status: Annotated[int, Field(ge=0, lt=128)] = 0
    """Exit status of the command, if this is the first failed step"""
    ends_all: bool = False
    """No further step is possible with this servo now"""
    seconds: Annotated[float, Field(ge=0.0, lt=1e9)] = 0.0
    data: dict[str, Any] = field(default_factory=dict)
    picture: str | None = None
    """File name of the PNG beside the JSON file"""


def partly_done(outcomes: Mapping[Step, StepOutcome], step: Step) -> dict[str, Any] | None:
    """Return a step's result, also of one that ended early; None if nothing was measured."""
    outcome = outcomes.get(step)
    return (outcome.data or None) if outcome is not None else None


def done(outcomes: Mapping[Step, StepOutcome], step: Step) -> dict[str, Any] | None:
    """Return a step's result; None if it is not done."""
    outcome = outcomes.get(step)
    return outcome.data if outcome is not None and outcome.state == "done" else None
