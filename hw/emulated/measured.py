"""Encodes the measurements of an emulated servo for its registers."""

from __future__ import annotations

import struct
from typing import Final

from haptic_wall.hw.dynamixel.registers import VELOCITY_UNIT
from haptic_wall.hw.emulated.control_modes import PWM_FULL
from haptic_wall.hw.emulated.drive import Drive

HELD_POSE: Final = (-1, -3)
"""Current and velocity [units] that a servo now and then measures while it holds a pose: side by
side their bytes begin as a frame does, so that the sender has to stuff them"""
_PRESENT = struct.Struct("<HBBhhiiiiHB")
"""Realtime Tick to Present Temperature, in the order of their addresses"""
_LOWEST, _HIGHEST = -0x8000_0000, 0x7FFF_FFFF
_LOAD_FULL = 1000
"""Present Load at full output [0.1 %]"""


def measured(drive: Drive, tick: int) -> bytes:
    """Return the bytes of the measured registers.

    The velocity is the true one, unfiltered. Present Load, which replaces Present Current in models
    without current control, is the output: "inferred from the internal output value".

    Args:
        drive: The servo's drive, advanced to the present time.
        tick: Realtime Tick.
    """
    table = drive.table
    # An unlimited motion may exceed the registers' range.
    position = min(max(drive.position(), _LOWEST), _HIGHEST)
    velocity = 0
    if drive.stuck_at is None:
        velocity = min(max(round(drive.mechanism.velocity / VELOCITY_UNIT), -_HIGHEST), _HIGHEST)
    amperes, duty = drive.electrical()
    unit = drive.current_unit
    current = round(amperes / unit) if unit else round(duty * _LOAD_FULL)
    pwm = round(duty * PWM_FULL)
    if table.inverts_current:
        velocity, current, pwm = -velocity, -current, -pwm
    if drive.held_pose:
        current, velocity = HELD_POSE
    status, lead_velocity, lead_position = drive.motion(position)
    return _PRESENT.pack(
        tick,
        abs(velocity) > table.memory["moving_threshold"],
        status,
        pwm,
        min(max(current, -0x8000), 0x7FFF),
        velocity,
        position,
        lead_velocity,
        lead_position,
        table.volts,
        min(max(round(table.temperature), 0), 0xFF),
    )
