"""Reads and validates the JSON file with the result of a commissioning step.

Validation is needed because a folder may come from another user or have been edited.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import replace
from typing import Annotated

from pydantic import BaseModel, ConfigDict, Field, TypeAdapter, ValidationError

from haptic_wall.controller.experiments.commission.outcome import Step, StepOutcome
from haptic_wall.controller.experiments.kept_folder import first_wrong
from haptic_wall.controller.experiments.sweep.result import PointResult

_HUGE = 1e9
"""Largest plausible quantity of a servo, in SI units"""
Number = Annotated[float, Field(ge=-_HUGE, le=_HUGE)]
Positive = Annotated[float, Field(gt=0.0, le=_HUGE)]
NotNegative = Annotated[float, Field(ge=0.0, le=_HUGE)]


class _Found(BaseModel):
    """Base of the models: declares the fields that the report uses, and keeps further fields."""

    model_config = ConfigDict(strict=True, extra="allow")


class _Estimate(BaseModel):
    model_config = ConfigDict(strict=True, extra="forbid")
    value: Number
    stderr: NotNegative


class _PositiveEstimate(_Estimate):
    value: Positive


class _Check(_Found):
    name: str
    ok: bool
    found: str
    wanted: str
    fix: str | None
    fixable: bool


class _Doctor(_Found):
    checks: list[_Check]
    fatal: list[str]
    reached: bool


class _Identify(_Found):
    inertia: _PositiveEstimate
    damping: _Estimate
    coulomb: _Estimate
    delay: _Estimate
    torque_gain: _PositiveEstimate
    torque_unit: str
    backlash: _Estimate | None
    warnings: list[str]
    config_text: str


class _Age(_Found):
    guard: NotNegative


class _Parts(_Found):
    age: _Age
    device: _Estimate


class _Inserted(_Found):
    inserted: NotNegative
    recovered: _Estimate | None


class _Delay(_Found):
    parts: _Parts
    points: list[_Inserted]


class _Wall(_Found):
    stiffness: Number
    damping: Number


class _Row(_Found):
    name: str
    unit: str
    commanded: Number | None
    rendered: Number | None
    stderr: NotNegative | None
    ratio: Number | None
    note: str


class _Rendered(_Found):
    commanded: _Wall
    rows: list[_Row]


class _Sweep(_Found):
    points: list[PointResult]


_DATA: Mapping[Step, type[BaseModel]] = {
    "doctor": _Doctor,
    "identify": _Identify,
    "delay": _Delay,
    "rendered": _Rendered,
    "sweep": _Sweep,
}
_OUTCOME = TypeAdapter(StepOutcome)


def read_outcome(text: str | bytes, step: Step) -> StepOutcome:
    """Parse and validate the JSON file of a step; return the step's outcome.

    Args:
        text: One JSON object in UTF-8.
        step: The step.

    Raises:
        ValueError: The text is not JSON, or not a result of the step; the message names the first
            invalid field.
    """
    try:
        outcome = _OUTCOME.validate_json(text, strict=True)
        if outcome.step != step:
            raise ValueError(f"step: found {outcome.step}, wanted {step}")
        if outcome.picture not in (None, picture_name(step)):
            raise ValueError(f"picture: found another name than {picture_name(step)}")
        # Of the failed steps only the doctor keeps its result.
        if outcome.state == "done" or outcome.data:
            text = json.dumps(outcome.data, allow_nan=False)
            data = _DATA[step].model_validate_json(text).model_dump(mode="json")
            outcome = replace(outcome, data=data)
    except ValidationError as error:
        raise ValueError(first_wrong(error)) from None
    return outcome


def file_name(step: Step) -> str:
    """Return the name of a step's JSON file in the folder."""
    return f"{step}.json"


def picture_name(step: Step) -> str:
    """Return the name of a step's picture in the folder."""
    return f"{step}.png"
