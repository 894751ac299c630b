"""Describes many walls on many servos, and cuts them into blocks that are simulated together."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, fields
from typing import Any

import numpy as np

from haptic_wall.controller.experiments.maps.tables import Table
from haptic_wall.controller.theory.checks import FloatArray, IntArray
from haptic_wall.hw.plant.current_loops import CurrentLoopParameters
from haptic_wall.hw.plant.encoders import ManyEncoderErrors
from haptic_wall.hw.plant.many_substeps import ManyEffects
from haptic_wall.hw.plant.many_two_masses import Transmissions, substeps

BLOCK = 4096
"""Walls simulated together: their arrays fit into the processor's second-level cache."""
_DELAYS = 8
"""Largest number of different delays in one block: each costs a copy per period."""
_SNAP = 1e-9  # fraction of a period: a delay this near to a whole number is taken as whole


@dataclass(frozen=True, slots=True)
class Walls:
    """Many walls on many servos; flat arrays of one length.

    The walls are at position 0; one-sided ones fill the positions above and push down.
    """

    inertia: FloatArray
    """m > 0 [kg·m²]"""
    damping: FloatArray
    """Viscous friction b >= 0 [N·m·s/rad]"""
    coulomb: FloatArray
    """Coulomb friction c >= 0 [N·m]"""
    counts_per_radian: FloatArray
    """Counts per radian of the encoder; 0: the position is not quantised"""
    backlash: FloatArray
    """Between shaft and encoder, full width, >= 0 [rad]"""
    torque_limit: FloatArray
    """[N·m], > 0, may be infinite"""
    torque_step: FloatArray
    """Torques are rounded to multiples of it [N·m]; 0: none"""
    stiffness: FloatArray
    """K [N·m/rad]"""
    virtual_damping: FloatArray
    """B [N·m·s/rad]"""
    period: FloatArray
    """T [s]"""
    whole: IntArray
    """Whole periods of the delay"""
    lag: FloatArray
    """Remainder of the delay beyond them [s], from 0 to less than T"""
    rest: FloatArray
    """T - lag [s]"""
    velocity_samples: IntArray
    """N of the velocity difference"""
    one_sided: np.ndarray[tuple[int], np.dtype[np.bool_]]
    """Whether the wall never pulls"""
    current_loop: CurrentLoopParameters | None = None
    """Current loop of the servos; None: their torque follows at once"""
    effects: ManyEffects | None = None
    """Effects beside inertia, viscous and Coulomb friction; None: none"""
    encoder: ManyEncoderErrors | None = None
    """Errors of their encoders besides counting; None: none"""
    transmission: Transmissions | None = None
    """Loads behind a transmission, without backlash and ``effects``; None: the servos are rigid"""

    law: Table | None = None
    """In place of the wall, whose ``one_sided`` is then not used; None: the wall"""

    @property
    def size(self) -> int:
        """Return the number of walls."""
        return self.inertia.size

    @property
    def moved(self) -> FloatArray:
        """Return the whole inertia that moves, loads included [kg·m²]."""
        loads = self.transmission
        return self.inertia if loads is None else self.inertia + loads.load_inertia

    def take(self, index: IntArray | slice) -> Walls:
        """Return the walls at ``index``."""
        values: dict[str, Any] = {field.name: getattr(self, field.name) for field in fields(self)}
        parts = {name: values.pop(name) for name in PARTS}
        parts = {name: part and part.take(index) for name, part in parts.items()}
        return Walls(**{name: array[index] for name, array in values.items()}, **parts)

    def with_stiffness(self, stiffness: FloatArray) -> Walls:
        """Return the walls with another stiffness; shape (n, ...) repeats each wall."""
        copies = stiffness.size // max(self.size, 1)
        many = self.take(np.repeat(np.arange(self.size), copies))
        values = {field.name: getattr(many, field.name) for field in fields(self)}
        return Walls(**{**values, "stiffness": stiffness.ravel()})


PARTS = ("current_loop", "effects", "encoder", "transmission", "law")
"""Fields of ``Walls`` that are no arrays, and may be None"""


def split_delay(delay: FloatArray, period: FloatArray) -> tuple[IntArray, FloatArray, FloatArray]:
    """Split a delay [s] into whole periods, the remainder, and the rest of that period [s]."""
    periods = delay / period
    whole = np.floor(periods + _SNAP)
    lag = np.where(periods - whole > _SNAP, delay - whole * period, 0.0)
    return whole.astype(np.int64), lag, period - lag


def blocks(walls: Walls, size: int = BLOCK) -> Iterator[IntArray]:
    """Yield indices of walls that can be simulated together: alike in what controls the simulation.

    Walls of one block may have a few different whole periods of delay.
    """
    kind = walls.whole // _DELAYS
    kind = kind * (int(walls.velocity_samples.max(initial=0)) + 1) + walls.velocity_samples
    for trait in (
        walls.one_sided,
        walls.lag > 0.0,
        walls.coulomb > 0.0,
        walls.counts_per_radian > 0.0,
        walls.backlash > 0.0,
        np.isfinite(walls.torque_limit),
        walls.torque_step > 0.0,
    ):
        kind = 2 * kind + trait
    if walls.transmission is not None:
        for part in (walls.lag, walls.rest):
            count = substeps(walls.inertia, walls.coulomb, walls.transmission, part)
            kind = kind * (int(count.max(initial=1)) + 1) + count
    order = np.lexsort((walls.whole, kind))
    cuts = np.flatnonzero(np.diff(kind[order])) + 1
    for alike in np.split(order, cuts):
        for start in range(0, alike.size, size):
            yield alike[start : start + size]
