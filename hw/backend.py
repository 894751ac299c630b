"""Defines the record of a servo backend: the program's knowledge about a kind of servo.

A backend is a file in ``haptic_wall.hw.backends``, and ``servo.backend`` of the configuration names
it. It is a record, as the program needs mostly facts of it.
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


def _nothing(_: Sequence[ServoSettings]) -> Iterable[Problem]:
    return ()


@dataclass(frozen=True, slots=True, kw_only=True)
class Backend:
    """The program's knowledge about a kind of servo, and the function that opens a bus of them.

    The functions get one ``ServoSettings`` a servo; ``port`` and the other settings of a bus are
    the same in each.
    """

    open: Callable[[Sequence[ServoSettings], Clock, int | None], Bus]
    """Opens a bus of the servos without starting it. The descriptor is that of its port, where
    ``open_port`` has opened one, perhaps in another process; the bus's ``close`` closes it, and
    so does a refusal. Raises ``haptic_wall.hw.errors.ServoError``"""
    simulated: bool = False
    """The servo is computed in the loop's process: ``servo.*`` are its true parameters, the
    simulated clock may run it, and no harm is possible. Otherwise replies travel over a bus, and
    the servo drops its torque after ``servo.watchdog_s`` without a message"""
    required: Mapping[str, str] = field(default_factory=dict)
    """Required fields of ``servo.*``, and their meaning, for people"""
    models: Callable[[], Mapping[str, TorqueModel]] = dict
    """The models that ``servo.model`` may name; of a simulated servo it is not used"""
    cycle_s: Callable[[Sequence[ServoSettings]], float] = lambda _: 0.0
    """Returns the least time of a cycle on the wire [s]"""
    problems: Callable[[Sequence[ServoSettings]], Iterable[Problem]] = _nothing
    """Finds conflicts between fields that are valid by themselves; ``field`` is one's path"""
    open_port: Callable[[Sequence[ServoSettings]], int | None] = lambda _: None
    """Opens the servos' port for this process and those it passes the descriptor to, and loads the
    modules of ``cut_torque``; None: it has no port. Raises ``haptic_wall.hw.errors.PortError``"""
    cut_torque: Callable[[Sequence[ServoSettings], int | None, Clock], bool] = lambda *_: True
    """Switches off the torque of servos whose driver is dead or hung; returns whether that was
    read back from each. The descriptor is that of its port, and stays open"""

    def kind(self, port: str | None) -> Kind:
        """Return the kind of servo behind this port."""
        if self.simulated:
            return "simulated"
        return "emulated" if port == EMULATED else "hardware"
