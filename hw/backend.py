"""Defines the record of a servo backend: the properties of a make of servo.

A backend is registered by name under the entry point group ``haptic_wall.servos``;
``servo.backend`` of the configuration names it. It is a record, not a class to inherit from: only
``open`` is required, and each default is the cautious one. A backend with defaults only drives a
real servo.

The program needs mostly facts of a backend, which need no inheritance, and a new fact breaks no
older backend. The built-in backends stand in ``haptic_wall.hw.open`` and not among the entry
points: those cost 50 ms at each start, and an editable install keeps old ones.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

from haptic_wall.hw.clock import Clock
from haptic_wall.hw.errors import Problem
from haptic_wall.hw.servo import Bus
from haptic_wall.hw.settings import EMULATED, ServoSettings
from haptic_wall.hw.truth import Kind


class TorqueModel(NamedTuple):
    """Facts about a model of servo that can be commanded in torque."""

    constant_known: bool
    """Its torque constant is published; otherwise it must be measured and configured"""
    no_load_speed: float
    """At its nominal supply [rad/s]; 0: not known"""


@dataclass(frozen=True, slots=True, kw_only=True)
class Backend:
    """The program's knowledge about a make of servo, and the function that opens a bus of them.

    The functions that take ``ServoSettings``, fields ``servo.*`` of the configuration, get one item
    a servo; ``port`` and the other settings of a bus are the same in each.
    """

    open: Callable[[Sequence[ServoSettings], Clock, int | None], Bus]
    """Opens a bus of the servos without starting it. The descriptor is that of its port, where
    ``open_port`` has opened one, perhaps in another process; the bus's ``close`` closes it, and
    so does a refusal. Raises ``haptic_wall.hw.errors.ServoError``"""
    several: bool = False
    """It opens several servos on one bus"""
    simulated: bool = False
    """The servo is computed in the loop's process: ``servo.*`` are its true parameters, the
    simulated clock may run it, and no harm is possible"""
    emulated_port: bool = False
    """``servo.port`` may be ``emulated``: a bus of ``haptic-wall emulate`` is started for it"""
    has_bus: bool = False
    """Replies travel over a bus, whose delay is measured before the wall comes on"""
    has_watchdog: bool = False
    """The servo drops its torque by itself after ``servo.watchdog_s`` without a message"""
    required: Mapping[str, str] = field(default_factory=dict)
    """Required fields of ``servo.*``, and their meaning, for people"""
    models: Callable[[], Mapping[str, TorqueModel]] | None = None
    """The models that ``servo.model`` may name; None: any, and no facts of them are known"""
    cycle_s: Callable[[Sequence[ServoSettings]], float] | None = None
    """Returns the least time of a cycle on the wire [s]; None: not known"""
    problems: Callable[[Sequence[ServoSettings]], Iterable[Problem]] | None = None
    """Finds conflicts between fields that are valid by themselves; ``field`` is one's path"""
    open_port: Callable[[Sequence[ServoSettings]], int | None] = lambda _: None
    """Opens the servos' port for this process and those it passes the descriptor to, and loads the
    modules of ``cut_torque``; None: it has no port. Raises ``haptic_wall.hw.errors.PortError``"""
    cut_torque: Callable[[Sequence[ServoSettings], int | None, Clock], bool] = lambda *_: False
    """Switches off the torque of servos whose driver is dead or hung; returns whether that was
    read back from each. The descriptor is that of its port, and stays open"""

    def kind(self, port: str | None) -> Kind:
        """Return the kind of servo behind this port."""
        if self.simulated:
            return "simulated"
        return "emulated" if self.emulated_port and port == EMULATED else "hardware"
