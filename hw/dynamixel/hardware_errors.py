"""Names the latched errors of a servo (Hardware Error Status), and the remedy of each.

Source: ROBOTIS e-Manual, Hardware Error Status (70) of the X series.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

from haptic_wall.hw.dynamixel.register_access import QUICK_NS, read_patiently
from haptic_wall.hw.dynamixel.station import Station
from haptic_wall.hw.dynamixel.tables import REGISTERS
from haptic_wall.hw.errors import ServoLostError

_BITS: Final[Mapping[int, tuple[str, str]]] = {
    0: ("input voltage", "bring its supply within Min and Max Voltage Limit (34, 32)"),
    2: ("overheating", "let it cool, and ask for less torque"),
    3: (
        "motor encoder",
        "have it repaired if the error comes back, because its position may be wrong",
    ),
    4: ("electrical shock", "look for a short circuit or a weak supply"),
    5: ("overload", "free its shaft, or lower servo.torque_limit"),
}
_STATUS: Final = REGISTERS["hardware_error_status"]


def error_names(error: int) -> str:
    """Return the names of the latched errors, for messages; empty if no known bit is set."""
    return ", ".join(name for bit, (name, _) in _BITS.items() if error >> bit & 1)


def what_to_do(error: int) -> str:
    """Return advice on the latched errors, to be put after a colon."""
    remedies = [remedy for bit, (_, remedy) in _BITS.items() if error >> bit & 1]
    remove = "; ".join(remedies) or "remove the cause"
    return f"{remove}; then reboot it, or switch its power off and on; only this clears the error"


def latched(station: Station, name: str) -> str:
    """Read the latched errors of a servo; return names and advice, or an empty text."""
    try:
        error = read_patiently(station, _STATUS, QUICK_NS)
    except ServoLostError:
        return ""
    if not error:
        return ""
    names = error_names(error) or f"0x{error:02x}"
    return f"the {name} has latched: {names}; {what_to_do(error)}"
