"""A servo backend: what the program must know of a make of servo before one is opened.

A backend is registered by name under the entry point group ``haptic_wall.servos``, and named by
``servo.backend`` of the configuration. It is a record, not a class to inherit from: only ``open``
is needed, and each default is the careful one. A backend that says nothing drives a real servo.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from typing import NamedTuple

from haptic_wall.hw.clock import Clock
from haptic_wall.hw.servo import Servo
from haptic_wall.hw.settings import EMULATED, Kind, ServoSettings


class TorqueModel(NamedTuple):
    """Facts of a model of servo that can be commanded in torque."""

    constant_known: bool
    """Its torque constant is published; else it must be measured and configured"""
    no_load_speed: float
    """At the supply that its figures hold for [rad/s]; 0: not known"""


@dataclass(frozen=True, slots=True)
class NoOptions:
    """The options of a backend that has none of its own."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Backend:
    """What the program knows of a make of servo, and how one is opened.

    The functions that take ``ServoSettings`` find this backend's own settings, checked, in
    ``settings.options``; the fields beside it are ``servo.*`` of the configuration, of which a
    backend takes what it needs.
    """

    open: Callable[[ServoSettings, Clock, int | None], Servo]
    """Opens a servo without starting it. The descriptor is that of its port, where
    ``open_port`` has opened one, perhaps in another process; the servo's ``close`` closes it, and
    so does a refusal. Raises ``haptic_wall.hw.errors.ServoError``"""
    options: type = NoOptions
    """The settings model: a dataclass, or whatever else pydantic can validate, of what
    ``servo.options`` may hold"""
    simulated: bool = False
    """The servo is computed in the loop's process: ``servo.*`` is its truth, the simulated clock
    may run it, and nothing can be hurt"""
    emulated_port: bool = False
    """``servo.port`` may be ``emulated``: a bus of ``haptic-wall emulate`` is started for it"""
    has_bus: bool = False
    """Replies travel over a bus, whose delay is measured before the wall comes on"""
    has_watchdog: bool = False
    """The servo drops its torque by itself after ``servo.watchdog_s`` without a message"""
    required: Mapping[str, str] = field(default_factory=dict)
    """Fields of ``servo.*`` that it cannot do without, and what is wanted there, for people"""
    models: Callable[[], Mapping[str, TorqueModel]] | None = None
    """The models that ``servo.model`` may name; None: any, and no facts of them are known"""
    cycle_s: Callable[[int], float] | None = None
    """How long a cycle is on the wire [s] at ``servo.baud`` [bit/s]; None: not known"""
    problems: Callable[[ServoSettings], Iterable[tuple[str, str]]] | None = None
    """Finds what cannot be in settings whose fields are right by themselves: the path of a field,
    and what was found and is wanted"""
    open_port: Callable[[ServoSettings], int] | None = None
    """Opens the servo's port for this process and those it hands the descriptor to, and loads what
    ``cut_torque`` needs. Raises ``haptic_wall.hw.errors.PortError``. None: it has no port"""
    cut_torque: Callable[[ServoSettings, int | None, Clock], bool] | None = None
    """Switches off the torque of a servo whose driver is dead or hung; whether that was read back.
    The descriptor is that of its port, and stays open. None: there is no way to"""

    def kind(self, port: str | None) -> Kind:
        """Kind of servo that is behind this port."""
        if self.simulated:
            return "simulated"
        return "emulated" if self.emulated_port and port == EMULATED else "hardware"
