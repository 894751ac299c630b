"""Friction models M1 to M6: the friction of a geared servo that moves, as a torque.

They add to Coulomb and viscous friction, one after another, friction that fades with speed
(Stribeck), and friction that grows with the load of the gear: effects of
``identify.motion_model``, by the same names.

Source: M. Duclusaud, G. Passault, V. Padois, O. Ly, "Extended Friction Models for the Physics
Simulation of Servo Actuators", arXiv:2410.08650, and its code, Rhoban bam (``bam/model.py``).
"""

from __future__ import annotations

import itertools
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
    spread: float = 0.5
    """Relative spread of the starts that are drawn around one"""


COULOMB = Term("coulomb", "N·m", 1.0, 0.2, 1e4)
VISCOUS = Term("damping", "N·m·s/rad", 1.0, 0.1, 200.0)
STRIBECK = Term("excess", "N·m", 0.3, 0.2, 1e4)
SPEED = Term("fading", "rad/s", 0.5, 0.1, 10.0, 0.02)
LOAD = Term("gear", "", 0.03, 0.02, 0.9)
LOAD_STRIBECK = Term("gear_rest", "", 0.03, 0.02, 0.9)
LOAD_MOTOR = Term("gear_motor", "", 0.03, 0.02, 0.9)
LOAD_MOTOR_STRIBECK = Term("gear_motor_rest", "", 0.03, 0.02, 0.9)
LOAD_QUADRATIC = Term("square", "1/(N·m)", 0.01, 1e-3)
LOAD_MOTOR_QUADRATIC = Term("square_motor", "1/(N·m)", 0.01, 1e-3)
LONGEST_DELAY_S = 0.1
_OTHERS = (
    Term("drag", "N·m·s²/rad²", 0.02, 0.05, 1e3),
    Term("sine", "N·m", 1.0, 1.0, least=-np.inf, spread=0.02),
    Term("cosine", "N·m", 1.0, 1.0, least=-np.inf, spread=0.3),
    Term("gain", "", 1.0, 1.0, least=-np.inf, spread=0.05),
    Term("delay", "s", 5e-4, 1e-3, LONGEST_DELAY_S, spread=0.2),
)

_STRIBECK = (STRIBECK, SPEED)
_DIRECTED = (LOAD, LOAD_MOTOR, LOAD_STRIBECK, LOAD_MOTOR_STRIBECK)
MODELS: dict[str, tuple[Term, ...]] = {
    "M1": (VISCOUS, COULOMB),
    "M2": (VISCOUS, COULOMB, *_STRIBECK),
    "M3": (VISCOUS, COULOMB, LOAD),
    "M4": (VISCOUS, COULOMB, *_STRIBECK, LOAD, LOAD_STRIBECK),
    "M5": (VISCOUS, COULOMB, *_STRIBECK, *_DIRECTED),
    "M6": (VISCOUS, COULOMB, *_STRIBECK, *_DIRECTED, LOAD_QUADRATIC, LOAD_MOTOR_QUADRATIC),
}
"""The parameters of each model"""
TERMS = {term.name: term for term in (*itertools.chain(*MODELS.values()), *_OTHERS)}
"""All parameters, by name"""
MEANING = {
    "M1": "Coulomb and viscous friction",
    "M2": "M1 and friction that fades with speed",
    "M3": "M1 and friction that grows with the gear's load",
    "M4": "M3, both fading with speed in part",
    "M5": "M4 with separate fractions for load and motor",
    "M6": "M5 and a part that grows with the square of the load",
}
FREE = ("M1", "M2", "M3", "M4")
"""Models that a free swing can tell apart: without motor torque M5 and M6 are M4"""
DRIVEN = ("M5", "M6")
"""Models that differ from M4 only where a motor is on"""
GAUSSIAN = 2.0
"""Exponent of the fading in these models"""
