"""Reads the servos of an emulated bus, and their true parameters, from the command line."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import replace
from typing import Any, Final

from haptic_wall.controller.cli.numbers import digits
from haptic_wall.controller.errors import UserError
from haptic_wall.hw.dynamixel.tables import MODELS, Model
from haptic_wall.hw.emulated.faults import suggestion
from haptic_wall.hw.errors import SpecError
from haptic_wall.hw.truth import ABOUT, TrueServo, read

# An MX-64: no identification of an XM430 is published.
# Source: Rhoban "bam" identification, Coulomb and viscous model (Apache-2.0).
DEFAULT_TRUTH = TrueServo(
    inertia=0.011951,
    damping=0.011692,
    coulomb=0.09039,
    position=math.pi,
    hand_origin=math.pi,
)
NAMES: Final = (*ABOUT, "kick")
"""What ``--set servo.NAME`` takes; ``kick``: the start's displacement from the wall"""


def truth_of(model: Model, given: Mapping[str, Any]) -> TrueServo:
    """Return the true parameters of an emulated servo: the given ones, and defaults of its model.

    Args:
        model: The model; its stall torque is the default torque limit.
        given: Values by name, as ``--set servo.NAME`` takes them.

    Raises:
        UserError: They are no servo's.
    """
    values = dict(given)
    if model.stall_torque is not None:
        values.setdefault("torque_limit", model.stall_torque)
    kick = values.pop("kick", None)
    if kick is not None:
        values["position"] = values.get("hand_origin", DEFAULT_TRUTH.hand_origin) + kick
    try:
        return replace(DEFAULT_TRUTH, **values)
    except SpecError as error:
        raise UserError(replace(error.problem, field=f"servo.{error.problem.field}")) from error


def given_truth(sets: Iterable[str]) -> dict[str, Any]:
    """Return the values of ``--set``, by name.

    Raises:
        UserError: A name is unknown, or a value is invalid.
    """
    given: dict[str, Any] = {}
    for text in sets:
        path, equals, value = text.partition("=")
        section, _, name = path.strip().partition(".")
        if not equals:
            raise UserError("no value", field="--set", given=text, advice="give servo.NAME=VALUE")
        if section != "servo" or name not in NAMES:
            hint = suggestion(name or section, NAMES, "servo.")
            raise UserError(
                "an emulated servo has no such parameter", field="--set", given=path, advice=hint
            )
        try:
            given[name] = read("position" if name == "kick" else name, value)
        except SpecError as error:
            raise UserError(replace(error.problem, field="--set", given=path)) from None
    if "kick" in given and "position" in given:
        raise UserError(
            field="--set",
            given="found both servo.kick and servo.position, which set the start",
            advice="give one of them",
        )
    return given


def servo_of(text: str) -> tuple[Model, int, int]:
    """Return model, id and firmware from MODEL[:ID[:FIRMWARE]].

    The default firmware is the first one with every emulated feature.

    Raises:
        UserError: The model is unknown, or a number is invalid.
    """
    name, *rest = text.split(":")
    model = {known.upper(): found for known, found in MODELS.items()}.get(name.strip().upper())
    if model is None:
        raise UserError(
            f"no model {name!r} is known",
            field="--servo",
            given=text,
            advice=suggestion(name.upper(), MODELS),
        )
    match [digits(number) for number in rest]:
        case []:
            return model, 1, model.fast_sync_read_firmware
        case [int(id_)]:
            return model, id_, model.fast_sync_read_firmware
        case [int(id_), int(firmware)]:
            return model, id_, firmware
    raise UserError(
        f"wanted MODEL[:ID[:FIRMWARE]], e.g. {model.name}:1:45", field="--servo", given=text
    )
