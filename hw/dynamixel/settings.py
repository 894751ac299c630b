"""The settings of the Dynamixel driver, the same for real and emulated servos."""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import Self

from haptic_wall.hw.settings import ServoSettings


@dataclass(frozen=True, slots=True)
class DynamixelSettings:
    """A Dynamixel on a serial port."""

    port: str
    """Device path; empty: an emulated bus in memory"""
    baud: int
    id: int
    model: str
    """Model name as in the control tables, e.g. XM430-W350"""
    torque_constant: float = 0.0
    """[N·m/A]; 0: the model's stall ratio"""
    torque_limit: float = 0.0
    """[N·m]; 0: the servo's own Current Limit"""
    watchdog_s: float = 0.04
    """Bus Watchdog [s], in steps of 0.02"""
    probe_torque: float = 0.3
    """Largest torque of the probe that verifies the torque's sign [N·m]; 0: no probe"""
    probe_direction: int = -1
    """Direction of the probe: away from the wall"""
    period_s: float = 1e-3
    """Of the loop that will drive it [s]: limits the additional bytes beside a sample"""
    max_speed: float | None = 0.0
    """Positions that imply a higher speed are refused [rad/s]; 0: none are; None: faster than
    ``Facts.fastest``"""
    speed_asked: bool = False
    """A user has set ``max_speed``: the start-up reports where it is above the servo's no-load
    speed"""

    @classmethod
    def of(cls, settings: ServoSettings) -> Self:
        """Return the driver's part of a servo's settings, without true parameters."""
        return cls(**{part.name: getattr(settings, part.name) for part in fields(cls)})
