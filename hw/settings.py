"""What a servo is made of: plain values, handed in from outside; the configuration fills them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Final, Literal

EMULATED: Final = "emulated"
"""The port that stands for an emulated bus of our own"""

Kind = Literal["simulated", "emulated", "hardware"]
HandName = Literal["none", "push", "tap", "lean"]
Schedule = Literal["immediate", "pipelined"]


@dataclass(frozen=True, slots=True)
class TrueServo:
    """What a simulated or emulated servo *is* (never what the controller believes of it)."""

    inertia: float
    """[kg·m²], > 0"""
    damping: float = 0.0
    """Viscous friction [N·m·s/rad], >= 0"""
    coulomb: float = 0.0
    """Coulomb friction [N·m], >= 0"""
    counts_per_rev: int = 4096
    """Encoder counts per revolution; 0: the position is not quantised"""
    delay: float = 0.0
    """From a torque's arrival at the servo to its action [s], >= 0"""
    torque_limit: float = 4.1
    """The servo saturates here [N·m], > 0"""
    torque_step: float = 0.0
    """Torques are rounded to multiples of it [N·m]; 0: none (a simulated servo only; an emulated
    one rounds to its current unit)"""
    backlash: float = 0.0
    """Play between the shaft and the encoder [rad], full width, >= 0"""
    torque_constant: float = 0.0
    """[N·m/A] of an emulated servo; 0: the model's stall ratio"""
    supply: float | None = None
    """Voltage of an emulated servo's supply [V]; None: the one its model's figures hold for"""
    ambient: float = 32.0
    """Temperature of an emulated servo that does nothing [°C]"""
    position: float = 0.0
    """Position at the start, at rest [rad]"""
    hand: HandName = "none"
    hand_origin: float = 0.0
    """Where the wall stands for the scripted hand [rad]"""
    hand_direction: int = 1
    """+1: the wall fills the positions above ``hand_origin``; -1: below"""


@dataclass(frozen=True, slots=True)
class ServoSettings:
    """What the configuration says of its servo; a backend takes from it what it knows.

    What a backend of somebody else needs beside is in ``options``.
    """

    backend: str = "simulated"
    """The name of the backend that opens it"""
    port: str = ""
    """Device path; empty: none, which for an emulated servo means a bus in memory"""
    baud: int = 0
    """Of the bus [bit/s]; 0: none is given"""
    id: int = 1
    """On the bus"""
    model: str = ""
    """Model name, e.g. XM430-W350"""
    torque_constant: float = 0.0
    """[N·m/A]; 0: the model's"""
    torque_limit: float = 0.0
    """[N·m]; 0: what the servo itself allows"""
    watchdog_s: float = 0.04
    """The servo drops its torque after this long without a message [s]"""
    probe_torque: float = 0.3
    """Largest torque of the probe that proves the torque's sign [N·m]; 0: no probe"""
    probe_direction: int = -1
    """Direction of the probe: away from the wall"""
    period_s: float = 1e-3
    """Of the loop that will drive it [s]"""
    max_speed: float | None = 0.0
    """Positions that it could reach only faster are refused [rad/s]; 0: none are; None: faster
    than ``Facts.fastest``"""
    speed_asked: bool = False
    """``max_speed`` was asked for by somebody"""
    true: TrueServo | None = None
    """What a simulated or emulated servo is; None: it is real, and nobody knows"""
    faults: tuple[str, ...] = ()
    """What goes wrong on an emulated bus, as ``haptic_wall.hw.emulated.faults`` reads it"""
    fault_seed: int = 0
    """Decides what those faults strike"""
    options: Any = None
    """The backend's own settings, an instance of its ``options``; None: it has none"""
