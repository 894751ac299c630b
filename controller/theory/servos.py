"""Published parameters of identified servos: inertia, friction and encoder, as starting values.

The values are facts about four servos, seen at the output shaft, of a model with Coulomb and
viscous friction. Units of one type differ, and wear: identify your own before you rely on them.

Source: Rhoban, "bam" (better actuator models), https://github.com/Rhoban/bam, Apache-2.0.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType


@dataclass(frozen=True, slots=True)
class ServoFacts:
    """Published parameters of a type of servo, at its output."""

    name: str
    inertia: float
    """m, the rotor's included [kg·m²]"""
    damping: float
    """Viscous friction b [N·m·s/rad]"""
    coulomb: float
    """Coulomb friction c [N·m]"""
    counts_per_rev: int
    """Encoder counts in one turn of the output"""


SERVOS: Mapping[str, ServoFacts] = MappingProxyType(
    {
        facts.name: facts
        for facts in (
            ServoFacts("MX-64", 0.011951, 0.011692, 0.09039, 4096),
            ServoFacts("MX-106", 0.026609, 0.035202, 0.10352, 4096),
            ServoFacts("XL330-M288", 0.0018142, 0.0036617, 0.012833, 4096),
            ServoFacts("XL-320", 0.0011190, 0.0033176, 0.027514, 1024),
        )
    }
)
"""Every known servo by name."""
