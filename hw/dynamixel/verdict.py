"""The parts of the table of rules: what a rule is, what it judges, and how it says so."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import NamedTuple

from haptic_wall.hw.dynamixel.health import DrivingRange
from haptic_wall.hw.dynamixel.register_access import Table
from haptic_wall.hw.dynamixel.tables import Model
from haptic_wall.hw.dynamixel.torque_law import TorqueLaw, torque_law
from haptic_wall.hw.errors import Problem
from haptic_wall.hw.servo import Check


class Verdict(NamedTuple):
    """The judgement of one thing.

    With ``ok``, ``advice`` says what could be better, unless it belongs to a fault, ``why``.
    """

    ok: bool
    found: str
    wanted: str
    why: str = ""
    """The fault as the begin of a sentence, which ``advice`` completes after a colon"""
    advice: str = ""
    """The remedy; empty: none is needed"""

    def check(self, name: str, *, fixable: bool = False) -> Check:
        """Return the line for people.

        Args:
            name: Name of the check.
            fixable: Whether ``doctor --fix`` can repair the fault.
        """
        why = "" if self.ok else self.why
        advice = "" if self.ok and self.why else self.advice
        fix = str(Problem(why, advice=advice, mark=": "))
        return Check(name, self.ok, self.found, self.wanted, fix, fixable=fixable and not self.ok)


class Repair(NamedTuple):
    """The repair of a fault: bits of a register, or a reboot where no register is named."""

    register: str = ""
    value: int | None = 0
    """None: the factory's"""
    mask: int = 0xFFFF
    """The affected bits of ``value``"""


@dataclass(frozen=True, slots=True)
class Seen:
    """The registers of a servo as read; missing ones do not exist in it."""

    table: Table
    values: Mapping[str, int]
    model: Model
    constant: float
    """Torque per current of the motor [N·m/A]"""
    torque_limit: float
    """The configured one [N·m]; 0: the servo's own"""

    def __getitem__(self, name: str) -> int:
        """Return the value of a register, which must exist."""
        return self.values[name]

    @property
    def volts(self) -> float:
        """Return the present supply [V]."""
        return self["present_input_voltage"] / 10

    @property
    def law(self) -> TorqueLaw:
        """Return the relation of goal currents and torques at the present supply."""
        return torque_law(self.model, self.constant, self.volts)

    def factory(self, name: str) -> int:
        """Return the factory setting of a register."""
        return self.table.registers[name].default

    def bounds(self, watchdog: int) -> DrivingRange:
        """Return the range in which the servo may be driven.

        Args:
            watchdog: Setting of Bus Watchdog [20 ms].
        """
        names = ("min_voltage_limit", "max_voltage_limit", "temperature_limit")
        return DrivingRange(watchdog, *(self[name] for name in names))


@dataclass(frozen=True, slots=True)
class Rule:
    """One row of the table."""

    name: str
    reads: tuple[str, ...]
    """The registers that it judges; the rule is for servos that have them"""
    judge: Callable[[Seen], Verdict]
    repair: Repair | None = None
    """None: a person's decision"""
    refuses: bool = False
    """Whether a start is refused by it"""
