"""Friction models M1 to M3: the friction of a geared servo that moves, as a torque.

M2 adds to Coulomb and viscous friction what fades with speed (Stribeck), M3 what grows with the
load of the gear: effects of ``identify.motion_model``, by the same names.

Source: M. Duclusaud, G. Passault, V. Padois, O. Ly, "Extended Friction Models for the Physics
Simulation of Servo Actuators", arXiv:2410.08650, and its code, Rhoban bam (``bam/model.py``).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True, slots=True)
class Term:
    """One parameter of a motion; those with a torque are fitted per inertia."""

    name: str
    unit: str
    start: float
    """Where a fit begins; a torque counts in units of the Coulomb friction"""
    size: float
    """Least size for its numerical derivative"""
    most: float = np.inf
    least: float = 0.0


LONGEST_DELAY_S = 0.1
_EVERY = (
    Term("damping", "N·m·s/rad", 1.0, 0.1, 200.0),
    Term("coulomb", "N·m", 1.0, 0.2, 1e4),
    Term("excess", "N·m", 0.3, 0.2, 1e4),
    Term("fading", "rad/s", 0.5, 0.1, 10.0, 0.02),
    Term("gear", "", 0.03, 0.02, 0.9),
    Term("drag", "N·m·s²/rad²", 0.02, 0.05, 1e3),
    Term("sine", "N·m", 1.0, 1.0, least=-np.inf),
    Term("cosine", "N·m", 1.0, 1.0, least=-np.inf),
    Term("gain", "", 1.0, 1.0, least=-np.inf),
    Term("delay", "s", 5e-4, 1e-3, LONGEST_DELAY_S),
)

TERMS = {term.name: term for term in _EVERY}
"""All parameters, by name"""
MODELS: dict[str, tuple[str, ...]] = {
    "M1": ("damping", "coulomb"),
    "M2": ("damping", "coulomb", "excess", "fading"),
    "M3": ("damping", "coulomb", "gear"),
}
"""The parameters of each model"""
MEANING = {
    "M1": "Coulomb and viscous friction",
    "M2": "M1 and friction that fades with speed",
    "M3": "M1 and friction that grows with the gear's load",
}
GAUSSIAN = 2.0
"""Exponent of the fading in these models"""
