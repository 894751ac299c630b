"""Reads three servos on one bus in one cycle, and commands them in one frame."""

from haptic_wall.hw.clock import MonotonicClock
from haptic_wall.hw.dynamixel.group import DynamixelGroup
from haptic_wall.hw.serialport.line import FdLine
from haptic_wall.hw.serialport.port import open_port
from haptic_wall.hw.settings import DriverSettings

clock = MonotonicClock()
line = FdLine(open_port("/dev/ttyUSB0", 4_000_000), clock)
group = DynamixelGroup(
    [DriverSettings("/dev/ttyUSB0", 4_000_000, n, "XM430-W350") for n in (1, 2, 3)], line
)
try:
    group.start()  # the checked start of each
    group.request()
    readings = group.collect(clock.now_ns() + 800_000)
    group.write([0.1, 0.0, -0.1])  # N·m, in one frame
finally:
    group.close()  # torque off of all, read back
