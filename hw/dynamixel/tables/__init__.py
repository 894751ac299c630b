"""Control tables and models of the Dynamixel X series, as data."""

from haptic_wall.hw.dynamixel.tables.models import MODELS, REGISTERS, Model, model_by_number
from haptic_wall.hw.dynamixel.tables.register import Register
from haptic_wall.hw.dynamixel.tables.units import (
    BAUD_RATES,
    COUNTS_PER_REV,
    CURRENT_MODE,
    EEPROM_END,
    POSITION_UNIT,
    RETURN_DELAY_UNIT_NS,
    TICK_MODULUS,
    VELOCITY_UNIT,
    WATCHDOG_TRIPPED,
    WATCHDOG_UNIT_NS,
    Family,
)

__all__ = [
    "BAUD_RATES",
    "COUNTS_PER_REV",
    "CURRENT_MODE",
    "EEPROM_END",
    "MODELS",
    "POSITION_UNIT",
    "REGISTERS",
    "RETURN_DELAY_UNIT_NS",
    "TICK_MODULUS",
    "VELOCITY_UNIT",
    "WATCHDOG_TRIPPED",
    "WATCHDOG_UNIT_NS",
    "Family",
    "Model",
    "Register",
    "model_by_number",
]
