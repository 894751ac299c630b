"""Checks which models can be driven in torque, and with which torque constant."""

from __future__ import annotations

from haptic_wall.hw.dynamixel.tables import MODELS, Model
from haptic_wall.hw.errors import UnfitServoError
from haptic_wall.hw.settings import DriverSettings


def drivable(settings: DriverSettings) -> tuple[Model, float]:
    """Return the configured model, and its torque constant [N·m/A].

    Raises:
        UnfitServoError: The model is unknown, has no current mode, or its constant is not known.
    """
    model = MODELS.get(settings.model)
    known = [each.name for each in MODELS.values() if each.current_mode]
    if model is None:
        raise UnfitServoError(
            f"The model {settings.model} is not known",
            advice=f"set servo.model to one of {', '.join(known)}.",
        )
    if not model.current_mode:
        kinds = dict.fromkeys(name.partition("-")[0] for name in known)
        raise UnfitServoError(
            f"The {model.name} has no current mode, so it cannot be commanded in torque",
            advice=f"use one of {', '.join(kinds)}.",
        )
    constant = settings.torque_constant or model.torque_constant
    if constant is None:
        raise UnfitServoError(
            f"The {model.name} has no published torque constant",
            advice="measure it and set servo.torque_constant [N·m/A].",
        )
    return model, constant
