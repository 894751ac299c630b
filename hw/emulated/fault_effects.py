"""Applies a fault to an emulated servo: to measurements, errors, supply, ambient or cable."""

from __future__ import annotations

from haptic_wall.hw.emulated.injection import FaultEvent
from haptic_wall.hw.emulated.servo import EmulatedServo

SILENCING = ("brown-out", "unplug")
"""Faults that truncate a reply on its way"""


def apply_fault(event: FaultEvent, servo: EmulatedServo, now_ns: int) -> None:
    """Begin or end the fault on ``servo`` at ``now_ns`` [ns]."""
    fault, begins = event
    servo.keep_up(now_ns)
    match fault.name:
        case "stuck" if begins:
            servo.mechanism.advance(now_ns)
            servo.drive.stuck_at = servo.drive.counts()
        case "stuck":
            servo.drive.stuck_at = None
        case "stuffing":
            servo.drive.held_pose = begins
        case "jump":
            counts: int = fault.values["counts"]
            servo.drive.shifted += counts if begins else -counts
        case "hardware-error" if not servo.unplugged:
            servo.latch_errors(fault.values["bits"], now_ns)
        case "supply":
            servo.set_supply(fault.values["volts"] if begins else servo.true_supply, now_ns)
        case "ambient":
            servo.set_ambient(fault.values["celsius"] if begins else servo.true_ambient, now_ns)
        case "unplug" if begins:
            servo.unplug(now_ns)
        case "unplug":
            servo.reboot(now_ns)
        case "brown-out" if not servo.unplugged:
            servo.reboot(now_ns)
