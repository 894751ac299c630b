"""Finds a servo backend by its name, and opens a bus of servos.

A real servo is never replaced by a simulated one: a port that cannot be opened is an error.
"""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import AbstractContextManager
from functools import cache
from importlib import import_module
from typing import Literal

from haptic_wall.hw.backend import Backend
from haptic_wall.hw.clock import Clock
from haptic_wall.hw.servo import Bus
from haptic_wall.hw.settings import ServoSettings

BackendName = Literal["simulated", "dynamixel"]
"""Files in ``haptic_wall.hw.backends``, imported on use"""


@cache
def backend(name: str) -> Backend:
    """Return the backend of this ``BackendName``."""
    found: Backend = import_module(f"haptic_wall.hw.backends.{name}").BACKEND
    return found


def open_bus(servos: Sequence[ServoSettings], clock: Clock, descriptor: int | None = None) -> Bus:
    """Return the bus of these servos, not started.

    Args:
        servos: At least one; backend, port and the other settings of a bus are those of the first.
        clock: Their clock.
        descriptor: Their port, where it is already open (from ``open_port``, perhaps
            inherited); the bus's ``close`` closes it, and so does a refusal. None: open it here.

    Raises:
        PortError: The port cannot be used.
        PortBusyError: Another program has it.
        UnfitServoError: A servo cannot be driven in torque as configured.
        ValueError: A simulated or emulated servo is impossible.
    """
    return backend(servos[0].backend).open(servos, clock, descriptor)


def open_port(servos: Sequence[ServoSettings]) -> int | None:
    """Return the servos' open port, which the caller closes; see ``Backend``."""
    return backend(servos[0].backend).open_port(servos)


def reserved(descriptor: int) -> AbstractContextManager[None]:
    """Return what keeps other programs off an open port, in a block that ends before it is closed.

    Args:
        descriptor: Descriptor from ``open_port``.
    """
    from haptic_wall.hw.serialport import users

    return users.reserved(descriptor)


def cut_torque(servos: Sequence[ServoSettings], descriptor: int | None, clock: Clock) -> bool:
    """Switch off the torque of servos whose driver is dead or hung; see ``Backend``."""
    return backend(servos[0].backend).cut_torque(servos, descriptor, clock)
