"""Hardware Error Status: what a servo has latched, and what a person does about each.

Source: ROBOTIS e-Manual, Hardware Error Status (70) of the X series.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

_BITS: Final[Mapping[int, tuple[str, str]]] = {
    0: ("input voltage", "bring its supply within Min and Max Voltage Limit (34, 32)"),
    2: ("overheating", "let it cool, and ask for less torque"),
    3: (
        "motor encoder",
        "have it repaired if the error comes back, since its position cannot be trusted",
    ),
    4: ("electrical shock", "look for a short circuit and for a supply that gives too little"),
    5: ("overload", "free its shaft, or lower servo.torque_limit"),
}


def error_names(error: int) -> str:
    """The latched errors by name, for people; empty where no known bit is set.

    Args:
        error: The register's value.
    """
    return ", ".join(name for bit, (name, _) in _BITS.items() if error >> bit & 1)


def what_to_do(error: int) -> str:
    """What to do about the latched errors: words to go on with after a colon.

    Args:
        error: The register's value.
    """
    remedies = [remedy for bit, (_, remedy) in _BITS.items() if error >> bit & 1]
    remove = "; ".join(remedies) or "remove the cause"
    return f"{remove}; then reboot it or switch its power off and on, nothing else clears it"
