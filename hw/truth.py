"""The true parameters of a simulated or emulated servo: each declared once, and checked here.

The configuration's ``servo.*``, the options of ``haptic-wall emulate`` and the plant take names,
ranges and meanings from ``TrueServo``.
"""

from __future__ import annotations

import json
import math
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import MISSING, dataclass, field, fields
from typing import Any, Final, Literal, NamedTuple, get_args, get_type_hints

from haptic_wall.hw.errors import Problem, SpecError

Kind = Literal["simulated", "emulated", "hardware"]
HandName = Literal["none", "push", "tap", "lean"]
EncoderSide = Literal["output", "motor"]

MOST_LOAD_FRICTION: Final = 0.9
"""Largest ``TrueServo.load_friction``: from 1 on no torque would ever move the servo"""


class Vibration(NamedTuple):
    """The vibration of two masses on a transmission whose ends are free."""

    rate: float
    """Without damping [rad/s]; 0: there is none"""
    ratio: float
    """Damping ratio by the transmission alone, to first order"""


class About(NamedTuple):
    """The declaration of a true parameter."""

    meaning: str
    unit: str = ""
    low: float = 0.0
    """Of a number, itself allowed; names have no range"""
    high: float = 1e6
    above: bool = False
    """``low`` itself is not allowed"""
    kinds: tuple[Kind, ...] = ("simulated", "emulated")
    """Kinds of servo whose configuration has it; none: derived from other settings"""


def _true(default: Any, *about: Any, **more: Any) -> Any:  # noqa: ANN401 - of the field's type
    """Declare a true parameter by its default and the fields of ``About``."""
    return field(default=default, metadata={"about": About(*about, **more)})


@dataclass(frozen=True, slots=True)
class TrueServo:
    """True parameters of a simulated or emulated servo (never the controller's belief).

    Raises:
        SpecError: A value is out of range, or does not fit another one.
    """

    # Motor and friction
    inertia: float = _true(MISSING, "True inertia", "kg·m²", 1e-8, 1e3)
    damping: float = _true(0.0, "True viscous friction", "N·m·s/rad", high=1e3)
    coulomb: float = _true(0.0, "True Coulomb friction", "N·m", high=1e4)
    damping_back: float | None = _true(
        None,
        "True viscous friction at negative velocities; null: servo.damping",
        "N·m·s/rad",
        high=1e3,
    )
    static_friction: float = _true(
        0.0,
        "True torque up to which the shaft stays at rest, at least servo.coulomb; 0: "
        "servo.coulomb. Published fits: 1.4 to 3.8 times the friction in motion",
        "N·m",
    )
    stribeck_speed: float = _true(
        0.0,
        "True speed over which the excess of the static friction falls by a factor e; 0: the "
        "excess ends as soon as the shaft moves. Published fits: 0.75 to 4.2",
        "rad/s",
        high=100,
    )
    # Friction of the gear under load
    load_friction: float = _true(
        0.0,
        "True fraction of the load on the gear (motor's less external torque) that adds to the "
        "friction. Published fits: 0.07 to 0.22",
        high=MOST_LOAD_FRICTION,
    )
    # Torques of the position
    gravity: float = _true(0.0, "True torque of a weight on a horizontal link", "N·m")
    gravity_angle: float = _true(0.0, "Position at which that weight hangs", "rad", low=-1e6)
    cogging: float = _true(
        0.0, "True amplitude of a torque that alternates with the position", "N·m"
    )
    cogging_periods: float = _true(24.0, "Periods of the cogging a turn", low=0.1, high=10_000)
    cogging_phase: float = _true(0.0, "Phase of the cogging at position 0", "rad", low=-1e6)
    # Transmission
    load_inertia: float = _true(
        0.0,
        "True inertia of the output behind a flexible transmission; servo.inertia and friction "
        "are then the motor's; 0: rigid",
        "kg·m²",
        high=1e3,
    )
    transmission_stiffness: float = _true(
        0.0, "True stiffness of that transmission", "N·m/rad", high=1e9
    )
    transmission_damping: float = _true(0.0, "True damping of that transmission", "N·m·s/rad")
    backlash: float = _true(
        0.0,
        "True backlash, full width: between shaft and encoder, or with a transmission between "
        "motor and output",
        "rad",
        high=1,
    )
    # Encoder
    encoder: EncoderSide = _true(  # noqa: RUF009 - immutable, as its names are
        "output",
        "Side of a flexible transmission that the encoder measures",
        kinds=("simulated", "emulated", "hardware"),
    )
    counts_per_rev: int = _true(
        4096,
        "Encoder counts per revolution; 0: the position is not quantised",
        "counts/rev",
        high=2**24,
    )
    encoder_eccentricity: float = _true(
        0.0, "True amplitude of the encoder's error once a turn", "rad", high=0.5
    )
    encoder_phase: float = _true(0.0, "Phase of the encoder's error at position 0", "rad", low=-1e6)
    encoder_noise: float = _true(
        0.0, "True noise of the encoder before it rounds, standard deviation", "counts", high=1000
    )
    noise_seed: int = _true(0, "Seed of the noise", high=2**48)
    # Current loop and motor
    delay: float = _true(
        0.0, "True lag, from a torque's arrival at the servo until it acts", "s", high=1
    )
    torque_limit: float = _true(
        4.1, "Torque at which the servo saturates", "N·m", 0, math.inf, above=True, kinds=()
    )
    torque_step: float = _true(
        0.0,
        "Step to which torques are rounded; 0: not rounded (an emulated servo rounds to its "
        "current unit)",
        "N·m",
        kinds=("simulated",),
    )
    torque_constant: float = _true(
        0.0,
        "Torque per current of an emulated servo; 0: the model's stall ratio",
        "N·m/A",
        kinds=(),
    )
    current_bandwidth: float = _true(
        0.0,
        "True bandwidth of the loop that controls the motor's current, first order; 0: the "
        "torque follows at once",
        "Hz",
        high=1e4,
    )
    current_period: float = _true(
        0.0,
        "True period of that loop, which accepts a goal at multiples of it; 0: at once",
        "s",
        high=0.01,
    )
    dead_band: float = _true(
        0.0,
        "True dead band: the motor makes this much less torque than commanded, and none below it",
        "N·m",
    )
    back_emf: bool = _true(
        False,
        "Whether the true torque in current mode falls with the speed: by the limit of the "
        "supply, and by servo.current_droop",
    )
    current_droop: float = _true(
        0.0,
        "Fraction of the back-EMF that the true current loop leaves uncorrected at the no-load "
        "speed, less in proportion below; with servo.back_emf",
        high=1,
    )
    no_load_speed: float = _true(
        4.82,
        "True no-load speed of a simulated servo with servo.back_emf, whose stall torque is "
        "servo.torque_limit; an emulated one has its model's",
        "rad/s",
        above=True,
        kinds=("simulated",),
    )
    # Start and operator
    position: float = _true(0.0, "Position at the start, at rest", "rad", -1e6, 1e6, kinds=())
    hand: HandName = _true(  # noqa: RUF009 - as above
        "none",
        "Scripted hand: push, slowly in and out of the wall; tap; lean, a steady push in the "
        "positive direction",
    )
    hand_origin: float = _true(
        0.0, "Position of the wall for the scripted hand", "rad", -1e6, 1e6, kinds=()
    )
    hand_direction: Literal[1, -1] = _true(
        1, "1: the scripted hand pushes toward positive positions; -1: negative", kinds=()
    )

    def __post_init__(self) -> None:
        for name in ABOUT:
            value = getattr(self, name)
            if not fits(name, value):
                raise _refusal(name, value)
        for problem in disagreements(self):
            raise SpecError(problem)

    @property
    def flexible(self) -> bool:
        """Whether a transmission lies between motor and output."""
        return self.load_inertia > 0.0


@dataclass(frozen=True, slots=True)
class TrueArm:
    """True links between the first servos of a simulated or emulated bus.

    Raises:
        SpecError: A value is out of range.
    """

    shape: Literal["none", "planar"] = _true(
        "none", "Links between the servos: planar, two in a horizontal plane, between the first two"
    )
    length_1: float = _true(0.15, "Length of the first link", "m", high=10, above=True)
    length_2: float = _true(0.15, "Length of the second link", "m", high=10, above=True)
    mass_1: float = _true(0.1, "Mass at the end of the first link", "kg", high=100)
    mass_2: float = _true(0.1, "Mass at the end of the second link", "kg", high=100)

    def __post_init__(self) -> None:
        for each in fields(self):
            name, value = f"arm.{each.name}", getattr(self, each.name)
            if not fits(name, value):
                raise _refusal(name, value)


ABOUT: Final[dict[str, About]] = {each.name: each.metadata["about"] for each in fields(TrueServo)}
"""The declarations by name"""
ARM: Final[dict[str, About]] = {
    f"arm.{each.name}": each.metadata["about"] for each in fields(TrueArm)
}
"""Those of the arm by their paths"""
TYPES: Final[dict[str, Any]] = get_type_hints(TrueServo) | {
    f"arm.{name}": kind for name, kind in get_type_hints(TrueArm).items()
}
_ALL: Final = ABOUT | ARM
NUMBERS: Final = (int, float, float | None)
"""Types of the true parameters that have a range"""


def fits(name: str, value: Any) -> bool:  # noqa: ANN401 - whatever was given
    """Whether this is a value of the true parameter, by itself."""
    about, kind = _ALL[name], TYPES[name]
    if kind not in NUMBERS:
        return isinstance(value, bool) if kind is bool else value in get_args(kind)
    if value is None:
        return kind not in (int, float)
    if isinstance(value, bool) or not isinstance(value, int if kind is int else (int, float)):
        return False
    return (about.low < value if about.above else about.low <= value) and value <= about.high


def wanted(name: str) -> str:
    """Return the accepted values of a true parameter in words."""
    about, kind = _ALL[name], TYPES[name]
    if kind not in NUMBERS:
        return "true or false" if kind is bool else "one of " + ", ".join(map(str, get_args(kind)))
    words = "a whole number" if kind is int else "a number"
    return f"{words} {'above' if about.above else 'from'} {about.low:g} to {about.high:g}"


def read(name: str, text: str) -> Any:  # noqa: ANN401 - of the parameter's type
    """Return a true parameter from its text, such as ``0.1``, ``true`` or ``push``.

    Raises:
        SpecError: The text is none of its values.
    """
    value: Any = text.strip()
    for parse in (float, json.loads):
        with suppress(ValueError, RecursionError):  # brackets may be nested too deeply
            value = parse(value.lower())
            break
    if isinstance(value, float) and value.is_integer() and TYPES[name] not in (float, float | None):
        value = int(value)
    with suppress(TypeError):
        if fits(name, value) and value != math.inf:
            return value
    raise SpecError(f"found {text!r}", wanted=wanted(name))


def vibration(true: Any) -> Vibration:  # noqa: ANN401 - or a section of these names
    """Return the vibration of a servo's two masses; zeros: it is rigid."""
    motor, load, joint = true.inertia, true.load_inertia, true.transmission_stiffness
    if not motor or not load or not joint:
        return Vibration(0.0, 0.0)
    rate = math.sqrt(joint * (1.0 / motor + 1.0 / load))
    return Vibration(rate, 0.5 * rate * true.transmission_damping / joint)


def disagreements(true: Any) -> Iterator[Problem]:  # noqa: ANN401 - or a section of these names
    """Yield the values that do not fit each other; the field's name is the parameter's."""
    if 0.0 < true.static_friction < true.coulomb:
        yield Problem(
            f"found {true.static_friction:g} N·m",
            wanted=f"at least servo.coulomb, {true.coulomb:g} N·m, or 0 for servo.coulomb",
            field="static_friction",
        )
    behind = (true.load_inertia, true.transmission_stiffness, true.transmission_damping)
    for name, value in zip(("load_inertia", "transmission_stiffness"), behind, strict=False):
        if value == 0.0 and (any(behind)):
            yield Problem(
                "found 0",
                wanted="above 0: a load behind a flexible transmission has both"
                " servo.load_inertia and servo.transmission_stiffness",
                field=name,
            )
    if true.encoder_noise > 0.0 and true.counts_per_rev == 0:
        yield Problem(
            f"found {true.encoder_noise:g} counts",
            wanted="0: servo.counts_per_rev is 0, so nothing is counted",
            field="encoder_noise",
        )


def _refusal(name: str, value: object) -> SpecError:
    return SpecError(f"found {value}", wanted=wanted(name), field=name)
