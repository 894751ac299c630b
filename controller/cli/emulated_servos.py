"""Reads the servos of an emulated bus, and their true parameters, from the command line."""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Iterable, Mapping
from dataclasses import replace
from typing import Any, get_args

from haptic_wall.controller.cli.numbers import digits
from haptic_wall.controller.errors import UserError
from haptic_wall.hw.dynamixel.tables import MODELS, Model
from haptic_wall.hw.emulated.faults import AMBIENT, SUPPLY
from haptic_wall.hw.emulated.values import flag, number, one_of, suggestion, whole
from haptic_wall.hw.settings import (
    LEAST_STRIBECK_EXPONENT,
    MOST_LINKS,
    MOST_LOAD_FRICTION,
    MOST_STRIBECK_EXPONENT,
    MOST_TORQUE_RIPPLE,
    EncoderSide,
    HandName,
    Link,
    TrueServo,
)

# An MX-64: no identification of an XM430 is published.
# Source: Rhoban "bam" identification, Coulomb and viscous model (Apache-2.0).
DEFAULT_TRUTH = TrueServo(
    inertia=0.011951,
    damping=0.011692,
    coulomb=0.09039,
    position=math.pi,
    hand_origin=math.pi,
)


def chain(text: str) -> tuple[Link, ...]:  # noqa: D103 - its docstring names the accepted values
    found = tuple(Link(*map(float, row)) for row in json.loads(text))
    if len(found) > MOST_LINKS or any(
        not (0 < inertia <= 1e6 and 0 < stiffness <= 1e9 and 0 <= damping <= 1e6)
        for inertia, stiffness, damping in found
    ):
        raise ValueError
    return found


chain.__doc__ = (
    f"a list of [inertia, stiffness, damping], at most {MOST_LINKS}: above 0, the damping from 0"
)

TRUTH: Mapping[str, Callable[[str], Any]] = {
    "inertia": number(0, 1e6, open_low=True),
    "damping": number(0, 1e6),
    "coulomb": number(0, 1e6),
    "counts_per_rev": whole(0, 2**24),
    "delay": number(0, 1),
    "torque_limit": number(0, 1e6, open_low=True),
    "torque_step": number(0, 1e6),
    "backlash": number(0, 1),
    "load_inertia": number(0, 1e6),
    "transmission_stiffness": number(0, 1e9),
    "transmission_damping": number(0, 1e6),
    "chain": chain,
    "encoder": one_of(*get_args(EncoderSide)),
    "current_bandwidth": number(0, 1e4),
    "current_period": number(0, 0.01),
    "dead_band": number(0, 1e6),
    "back_emf": flag,
    "current_droop": number(0, 1),
    "no_load_speed": number(0, 1e6, open_low=True),
    "current_filter": number(0, 1e4),
    "current_offset": number(-10, 10),
    "static_friction": number(0, 1e6),
    "stribeck_speed": number(0, 100),
    "stribeck_exponent": number(LEAST_STRIBECK_EXPONENT, MOST_STRIBECK_EXPONENT),
    "damping_back": number(0, 1e6),
    "load_friction": number(0, MOST_LOAD_FRICTION),
    "load_friction_external": number(0, MOST_LOAD_FRICTION),
    "load_friction_at_rest": number(0, MOST_LOAD_FRICTION),
    "load_friction_at_rest_external": number(0, MOST_LOAD_FRICTION),
    "load_friction_square": number(0, 10),
    "load_friction_square_external": number(0, 10),
    "gravity": number(0, 1e6),
    "gravity_angle": number(-1e6, 1e6),
    "cogging": number(0, 1e6),
    "cogging_periods": number(0.1, 10_000),
    "cogging_phase": number(-1e6, 1e6),
    "torque_ripple": number(0, MOST_TORQUE_RIPPLE),
    "torque_ripple_periods": number(0.1, 10_000),
    "torque_ripple_phase": number(-1e6, 1e6),
    "encoder_eccentricity": number(0, 0.5),
    "encoder_phase": number(-1e6, 1e6),
    "encoder_noise": number(0, 1000),
    "noise_seed": whole(0, 2**32),
    "torque_constant": number(0, 1e6),
    "supply": SUPPLY,
    "ambient": AMBIENT,
    "position": number(-1e6, 1e6),
    "kick": number(-100, 100),
    "hand": one_of(*get_args(HandName)),
    "hand_origin": number(-1e6, 1e6),
    "hand_direction": one_of(1, -1),
}


def truth_of(model: Model, given: Mapping[str, Any]) -> TrueServo:
    """Return the true parameters of an emulated servo: the given ones, and defaults of its model.

    Args:
        model: The model; its stall torque is the default torque limit.
        given: Values by name, as ``--set servo.NAME`` takes them.
    """
    values = dict(given)
    if model.stall_torque is not None:
        values.setdefault("torque_limit", model.stall_torque)
    kick = values.pop("kick", None)
    true = replace(DEFAULT_TRUTH, **values)
    return true if kick is None else replace(true, position=true.hand_origin + kick)


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
        if section != "servo" or name not in TRUTH:
            hint = suggestion(name or section, TRUTH, "servo.")
            raise UserError(
                "an emulated servo has no such parameter", field="--set", given=path, advice=hint
            )
        parse = TRUTH[name]
        try:
            given[name] = parse(value.strip())
        except (ValueError, KeyError, TypeError):
            raise UserError(
                f"found {value!r}", field="--set", given=path, wanted=parse.__doc__
            ) from None
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
