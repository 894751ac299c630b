"""The settings of a servo, as plain values."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final, Literal

from haptic_wall.hw.truth import TrueArm, TrueServo

EMULATED: Final = "emulated"
"""The port value that selects the program's own emulated bus"""

BackendName = Literal["simulated", "dynamixel"]
Way = Literal["auto", "fast", "sync", "plain"]
"""How several servos are read: ``auto`` is ``fast``, else ``sync``"""
Schedule = Literal["immediate", "pipelined"]


@dataclass(frozen=True, slots=True)
class DriverSettings:
    """The part of a servo's settings that a driver may know: nothing of a simulated truth."""

    port: str = ""
    """Device path; empty: none, which for an emulated servo means a bus in memory"""
    baud: int = 0
    """Baud rate of the bus [bit/s]; 0: not given"""
    id: int = 1
    """On the bus"""
    model: str = ""
    """Model name, e.g. XM430-W350"""
    torque_constant: float = 0.0
    """[N·m/A]; 0: the model's"""
    torque_limit: float = 0.0
    """[N·m]; 0: the servo's own"""
    watchdog_s: float = 0.04
    """The servo drops its torque after this long without a message [s]"""
    probe_torque: float = 0.3
    """Largest torque of the probe that proves the torque's sign [N·m]; 0: no probe"""
    probe_direction: int = -1
    """Direction of the probe: away from the wall"""
    period_s: float = 1e-3
    """Period of the loop that will drive it [s]: limits the additional bytes beside a sample"""
    read: Way = "auto"
    """How several servos of the bus are read"""
    sign: int = 1
    """1, -1: position = sign * the servo's own + offset, and torques turn with the sign. The loop
    applies both; a bus reads and commands the servo's own"""
    offset: float = 0.0
    """See ``sign`` [rad]"""


@dataclass(frozen=True, slots=True)
class ServoSettings(DriverSettings):
    """The configuration of a servo; a backend uses the fields it knows."""

    backend: BackendName = "simulated"
    """simulated: in the loop's process; dynamixel: on a bus"""
    true: TrueServo | None = None
    """True parameters of a simulated or emulated servo; None: it is real"""
    arm: TrueArm | None = None
    """True links between the servos of its bus; None: there are none, as with their shape none"""
    faults: tuple[str, ...] = ()
    """Injected faults of an emulated bus, in the syntax of ``haptic_wall.hw.emulated.faults``"""
    fault_seed: int = 0
    """Seed of those faults' random choices"""
