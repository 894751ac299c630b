"""Builds the command for the emulated bus that a run starts for itself."""

from __future__ import annotations

from dataclasses import fields
from pathlib import Path

from haptic_wall.hw.settings import DynamixelSettings, TrueServo


def emulator_arguments(
    settings: DynamixelSettings, true: TrueServo, witness: Path | None, *, force: bool = False
) -> list[str]:
    """Return the arguments after ``python -m`` that start an emulated bus with one servo."""
    arguments = ["haptic_wall.controller.cli.main", "emulate", "--die-with-parent"]
    arguments += ["--servo", f"{settings.model}:{settings.id}", "--baud", str(settings.baud)]
    arguments += ["--seed", str(settings.fault_seed)]
    for fault in settings.faults:
        arguments += ["--fault", fault]
    for part in fields(true):
        value = getattr(true, part.name)
        if value is not None:
            arguments += ["--set", f"servo.{part.name}={value}"]
    if witness is not None:
        arguments += ["--record", str(witness), *(["--force"] if force else [])]
    return arguments
