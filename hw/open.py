"""The registry of servo backends: finds a backend by its name, and opens a bus of servos.

A real servo is never replaced by a simulated one: a port that cannot be opened is an error.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import AbstractContextManager
from functools import cache
from importlib import import_module
from typing import TYPE_CHECKING, Final

from haptic_wall.hw.backend import Backend
from haptic_wall.hw.clock import Clock
from haptic_wall.hw.errors import BackendError
from haptic_wall.hw.servo import Bus
from haptic_wall.hw.settings import ServoSettings

if TYPE_CHECKING:
    from importlib.metadata import EntryPoint

GROUP: Final = "haptic_wall.servos"
"""The entry point group in which a distribution registers its backends, ``NAME =
"module:ATTRIBUTE"``"""
_OURS: Final[Mapping[str, str]] = {
    "simulated": "haptic_wall.hw.backends.simulated:BACKEND",
    "dynamixel": "haptic_wall.hw.backends.dynamixel:BACKEND",
}
"""Entry points of this distribution. They are repeated here because reading the metadata of all
installed distributions takes 50 ms at each start, and an editable install keeps old metadata"""


def backend_names() -> list[str]:
    """Return the names of all backends: ours, then those of installed distributions."""
    return [*_OURS, *sorted(_installed())]


@cache
def backend(name: str) -> Backend:
    """Return the backend of this name.

    Raises:
        BackendError: There is none, or it cannot be loaded.
    """
    if name in _OURS:
        module, _, attribute = _OURS[name].partition(":")
        ours: Backend = getattr(import_module(module), attribute)
        return ours
    entries = _installed().get(name, [])
    if not entries:
        raise BackendError(
            f"No servo backend is called {name!r}",
            advice=f"known are {', '.join(backend_names())}.",
        )
    whose = " and ".join(sorted({entry.dist.name for entry in entries if entry.dist}))
    if len(entries) > 1:
        raise BackendError(
            f"The servo backend {name!r} is registered more than once, by {whose}",
            advice="uninstall all but one.",
        )
    try:
        found = entries[0].load()
    except Exception as error:
        raise BackendError(
            f"The servo backend {name!r} of the distribution {whose} cannot be "
            f"loaded ({type(error).__name__}: {error})",
            advice="install its dependencies, or another version of it.",
        ) from error
    if not isinstance(found, Backend):
        raise BackendError(
            f"The servo backend {name!r} of the distribution {whose} is a "
            f"{type(found).__name__}, wanted a haptic_wall.hw.backend.Backend",
            advice="install another version of it.",
        )
    return found


def _installed() -> dict[str, list[EntryPoint]]:
    """Return entry points of other distributions by name; names of ours are ignored."""
    from importlib.metadata import entry_points  # not at the top: it takes long

    found: dict[str, list[EntryPoint]] = {}
    for entry in entry_points(group=GROUP):
        if entry.name not in _OURS:
            found.setdefault(entry.name, []).append(entry)
    return found


def open_bus(servos: Sequence[ServoSettings], clock: Clock, descriptor: int | None = None) -> Bus:
    """Return the bus of these servos, not started.

    Args:
        servos: At least one; backend, port and the other settings of a bus are those of the first.
        clock: Their clock.
        descriptor: Their port, where it is already open (from ``open_port``, perhaps
            inherited); the bus's ``close`` closes it, and so does a refusal. None: open it here.

    Raises:
        BackendError: There is no such backend, or it cannot be loaded.
        PortError: The port cannot be used.
        PortBusyError: Another program has it.
        UnfitServoError: A servo cannot be driven in torque as configured, or the backend drives
            no several.
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
