"""The settings of a servo and the true parameters of a simulated one, as plain values."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, fields
from itertools import pairwise
from typing import Any, Final, Literal, NamedTuple

EMULATED: Final = "emulated"
"""The port value that selects the program's own emulated bus"""

Kind = Literal["simulated", "emulated", "hardware"]
HandName = Literal["none", "push", "tap", "lean"]
Schedule = Literal["immediate", "pipelined"]
EncoderSide = Literal["output", "motor"]


MOST_LOAD_FRICTION: Final = 0.9
"""Largest ``TrueServo.load_friction``: from 1 on no torque would ever move the servo"""
MOST_LINKS: Final = 8
"""Longest ``TrueServo.chain``"""
LEAST_STRIBECK_EXPONENT: Final = 0.5
MOST_STRIBECK_EXPONENT: Final = 10.0
"""Range of ``TrueServo.stribeck_exponent``: published fits have 0.76 to 8.7"""
MOST_TORQUE_RIPPLE: Final = 0.9
"""Largest ``TrueServo.torque_ripple``: from 1 on the motor would turn round"""


class Link(NamedTuple):
    """A mass, and the joint that holds it to the mass before it."""

    inertia: float
    """[kg·m²], > 0"""
    stiffness: float
    """Of the joint [N·m/rad], > 0"""
    damping: float
    """Of the joint [N·m·s/rad], >= 0"""


class Vibration(NamedTuple):
    """One vibration of a chain of masses whose ends are free."""

    rate: float
    """Without damping [rad/s]"""
    ratio: float
    """Damping ratio by the joints alone, to first order"""


def vibrations(inertia: float, links: Sequence[Link]) -> list[Vibration]:
    """Return the vibrations of a chain, the slowest first: one for each joint.

    Args:
        inertia: Inertia of the first mass [kg·m²].
        links: The masses behind it, at least one.
    """
    if len(links) == 1:
        rate = math.sqrt(links[0].stiffness * (1.0 / inertia + 1.0 / links[0].inertia))
        return [Vibration(rate, 0.5 * rate * links[0].damping / links[0].stiffness)]
    import numpy as np  # not at the top: of an emulated bus it is half the start

    # In q = sqrt(k) twist the chain is q'' = -S (q + (c/k) q'), with a symmetric S.
    ease = [1.0 / inertia, *(1.0 / link.inertia for link in links)]
    root = np.sqrt([link.stiffness for link in links])
    whole = np.diag([a + b for a, b in pairwise(ease)])
    beside = np.arange(len(links) - 1)
    whole[beside, beside + 1] = whole[beside + 1, beside] = np.negative(ease[1:-1])
    squares, shapes = np.linalg.eigh(whole * root * root[:, None])
    rates = np.sqrt(np.maximum(squares, 0.0))
    fades = np.array([link.damping / link.stiffness for link in links])
    ratios = 0.5 * rates * (shapes**2 * fades[:, None]).sum(axis=0)
    return list(map(Vibration, rates.tolist(), ratios.tolist()))


@dataclass(frozen=True, slots=True)
class TrueServo:
    """True parameters of a simulated or emulated servo (never the controller's belief)."""

    inertia: float
    """[kg·m²], > 0"""
    damping: float = 0.0
    """Viscous friction [N·m·s/rad], >= 0"""
    coulomb: float = 0.0
    """Coulomb friction [N·m], >= 0"""
    counts_per_rev: int = 4096
    """Encoder counts per revolution; 0: the position is not quantised"""
    delay: float = 0.0
    """From a torque's arrival at the servo until it acts [s], >= 0"""
    torque_limit: float = 4.1
    """Torque at which the servo saturates [N·m], > 0"""
    torque_step: float = 0.0
    """Torques are rounded to multiples of it [N·m]; 0: none (a simulated servo only; an emulated
    one rounds to its current unit)"""
    backlash: float = 0.0
    """Between the shaft and the encoder [rad], full width, >= 0; with a transmission: between the
    masses"""
    load_inertia: float = 0.0
    """Inertia of the output, behind a flexible transmission [kg·m²], >= 0; 0: the servo is
    rigid. ``inertia`` and friction are then those of the motor's side"""
    transmission_stiffness: float = 0.0
    """[N·m/rad], > 0 with a ``load_inertia``, else 0"""
    transmission_damping: float = 0.0
    """[N·m·s/rad], >= 0"""
    chain: tuple[Link, ...] = ()
    """Further masses behind the output, each on the one before; operator and weight are then at
    the last one"""
    encoder: EncoderSide = "output"
    """Side of the transmission that the encoder measures"""
    static_friction: float = 0.0
    """Torque up to which it stays at rest [N·m], at least ``coulomb``; 0: as much as that"""
    stribeck_speed: float = 0.0
    """Speed over which the excess of the static friction falls by a factor e [rad/s], >= 0; 0: it
    is gone as soon as the shaft moves"""
    stribeck_exponent: float = 1.0
    """Exponent of that fall, 0.5 to 10"""
    damping_back: float | None = None
    """Viscous friction at negative velocities [N·m·s/rad], >= 0; None: ``damping``"""
    load_friction: float = 0.0
    """Share of the load, the difference of motor's and external torque, that the gear adds to the
    friction; below 1"""
    load_friction_external: float | None = None
    """The external torque has this share instead; None: ``load_friction`` of both"""
    load_friction_at_rest: float = 0.0
    """Increase of ``load_friction`` at rest; it falls with the speed as ``static_friction`` does"""
    load_friction_at_rest_external: float | None = None
    """The external torque has this instead; None: ``load_friction_at_rest`` of both"""
    load_friction_square: float = 0.0
    """Share of the square of the motor's torque at rest, while a larger external torque opposes it
    [1/(N·m)], >= 0"""
    load_friction_square_external: float = 0.0
    """Share of the square of the external torque at rest, while a larger torque of the motor
    opposes it [1/(N·m)], >= 0"""
    gravity: float = 0.0
    """Torque of a weight on a horizontal link [N·m], >= 0"""
    gravity_angle: float = 0.0
    """Position at which the weight hangs [rad]"""
    cogging: float = 0.0
    """Amplitude of a torque that alternates with the position [N·m], >= 0"""
    cogging_periods: float = 24.0
    """Its periods a turn, > 0"""
    cogging_phase: float = 0.0
    """Its phase at position 0 [rad]"""
    torque_ripple: float = 0.0
    """The motor's torque varies with the position by this share of it, 0 to 0.9"""
    torque_ripple_periods: float = 24.0
    """Periods of that a turn, > 0"""
    torque_ripple_phase: float = 0.0
    """Its phase at position 0 [rad]"""
    encoder_eccentricity: float = 0.0
    """Amplitude of the encoder's error once a turn [rad], >= 0, below 1"""
    encoder_phase: float = 0.0
    """Phase of that error at position 0 [rad]"""
    encoder_noise: float = 0.0
    """Standard deviation of the encoder's noise [counts], >= 0"""
    noise_seed: int = 0
    """Decides what the noise is"""
    torque_constant: float = 0.0
    """[N·m/A] of an emulated servo; 0: the model's stall ratio"""
    current_bandwidth: float = 0.0
    """Bandwidth of the loop that controls the motor's current [Hz], first order; 0: the
    torque follows at once"""
    current_period: float = 0.0
    """Goals are taken over at multiples of it [s]; 0: at once"""
    dead_band: float = 0.0
    """The motor makes so much less than what is commanded, and nothing below [N·m]"""
    back_emf: bool = False
    """In current mode too the back-EMF counts: the supply limits the torque at the present speed,
    and the current loop has to make up for the speed"""
    current_droop: float = 0.0
    """Fraction of the back-EMF that the current loop leaves at the no-load speed, and less in
    proportion below; with ``back_emf``"""
    no_load_speed: float = 4.82
    """No-load speed of a simulated servo with back-EMF [rad/s]; its stall torque is
    ``torque_limit``. An emulated one has its model's"""
    current_filter: float = 0.0
    """Filter of the measured current [Hz], first order; 0: none"""
    current_offset: float = 0.0
    """Added to the measured current of an emulated servo [A]"""
    supply: float | None = None
    """Voltage of an emulated servo's supply [V]; None: its model's nominal one"""
    ambient: float = 32.0
    """Temperature of an emulated servo without load [°C]"""
    position: float = 0.0
    """Position at the start, at rest [rad]"""
    hand: HandName = "none"
    hand_origin: float = 0.0
    """Position of the wall for the scripted operator [rad]"""
    hand_direction: int = 1
    """+1: the wall fills the positions above ``hand_origin``; -1: below"""

    @property
    def flexible(self) -> bool:
        """Whether a transmission lies between motor and output."""
        return any(self.links[0]) or bool(self.chain)

    @property
    def links(self) -> tuple[Link, ...]:
        """Return the output and the masses behind it."""
        output = Link(self.load_inertia, self.transmission_stiffness, self.transmission_damping)
        return output, *self.chain


@dataclass(frozen=True, slots=True)
class DriverSettings:
    """The part of a servo's settings that a driver may know: nothing of a simulated truth."""

    port: str = ""
    """Device path; empty: none, which for an emulated servo means a bus in memory"""
    baud: int = 0
    """Baud rate of the bus [bit/s]; 0: not given"""
    id: int = 1
    """On the bus"""
    model: str = ""
    """Model name, e.g. XM430-W350"""
    torque_constant: float = 0.0
    """[N·m/A]; 0: the model's"""
    torque_limit: float = 0.0
    """[N·m]; 0: the servo's own"""
    watchdog_s: float = 0.04
    """The servo drops its torque after this long without a message [s]"""
    probe_torque: float = 0.3
    """Largest torque of the probe that proves the torque's sign [N·m]; 0: no probe"""
    probe_direction: int = -1
    """Direction of the probe: away from the wall"""
    period_s: float = 1e-3
    """Period of the loop that will drive it [s]: limits the additional bytes beside a sample"""
    max_speed: float | None = 0.0
    """Positions that imply a higher speed are refused [rad/s]; 0: none are; None: faster than
    ``Facts.fastest``"""
    speed_asked: bool = False
    """A user has set ``max_speed``: the start-up reports where it is above the servo's no-load
    speed"""


@dataclass(frozen=True, slots=True)
class ServoSettings(DriverSettings):
    """The configuration of a servo; a backend uses the fields it knows.

    Further settings of another distribution's backend are in ``options``.
    """

    backend: str = "simulated"
    """Name of the backend that opens it"""
    true: TrueServo | None = None
    """True parameters of a simulated or emulated servo; None: it is real"""
    faults: tuple[str, ...] = ()
    """Injected faults of an emulated bus, in the syntax of ``haptic_wall.hw.emulated.faults``"""
    fault_seed: int = 0
    """Seed of those faults' random choices"""
    options: Any = None
    """The backend's own settings, an instance of its ``options``; None: it has none"""

    def driver(self) -> DriverSettings:
        """Return the driver's part."""
        names = (part.name for part in fields(DriverSettings))
        return DriverSettings(**{name: getattr(self, name) for name in names})
