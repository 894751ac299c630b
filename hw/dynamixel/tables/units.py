"""Units of the numbers in a control table, where all X series servos agree.

Source: ROBOTIS e-Manual, control table pages of the X series.
"""

from __future__ import annotations

import math
from typing import Final, Literal

Family = Literal["X430", "X540", "XW430", "XW540", "X330", "XL430", "2X430"]
"""Models with the same registers; ``XL430`` are all 430 without current control, ``2X430`` those
among them with two axes, each of which is a servo of its own on the bus."""

COUNTS_PER_REV: Final = 4096
POSITION_UNIT: Final = 2 * math.pi / COUNTS_PER_REV
"""[rad] per count"""
VELOCITY_UNIT: Final = 0.229 * 2 * math.pi / 60
"""[rad/s] per unit: 0.229 rev/min"""
RETURN_DELAY_UNIT_NS: Final = 2_000
"""[ns] per unit of Return Delay Time"""
WATCHDOG_UNIT_NS: Final = 20_000_000
"""[ns] per unit of Bus Watchdog"""
WATCHDOG_TRIPPED: Final = 0xFF
"""Value of Bus Watchdog after a trip: -1"""
TICK_MODULUS: Final = 32_768
"""Realtime Tick counts milliseconds and wraps from 32767 to 0"""
EEPROM_END: Final = 64
CURRENT_MODE: Final = 0
BAUD_RATES: Final = (9600, 57600, 115200, 1_000_000, 2_000_000, 3_000_000, 4_000_000, 4_500_000)
"""Indexed by the value of the Baud Rate register [bit/s]"""
