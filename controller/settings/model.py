"""Defines the sections of the configuration: every field with unit, bounds and meaning."""

from __future__ import annotations

from typing import Annotated, Any, Final, Generic, Literal, TypeVar

from pydantic import (
    BaseModel,
    BeforeValidator,
    ConfigDict,
    Field,
    model_validator,
)

from haptic_wall.controller.laws.table import LAWS, SUM
from haptic_wall.controller.laws.wall import NONE, Side
from haptic_wall.hw.truth import Kind


def whole(found: Any) -> Any:  # noqa: ANN401 - whatever the file holds
    """Convert a whole float such as ``4e6`` to an integer; return any other value unchanged."""
    return int(found) if isinstance(found, float) and found.is_integer() else found


Whole = Annotated[int, BeforeValidator(whole)]
Positive = Annotated[float, Field(gt=0, le=1e6)]
MOST_LAG: Final = 0.1
"""Longest believed lag [s]"""
BelievedLag = Annotated[float, Field(ge=0, le=MOST_LAG)]
Bandwidth = Annotated[float, Field(ge=1, le=1e6)]
Gain = Annotated[float, Field(ge=1e-3, le=10)]
Inertia = Annotated[float, Field(ge=1e-8, le=1e3)]
"""From a thousandth of the smallest servo's to a thousand times that of a robot's arm"""
LoadInertia = Annotated[float, Field(ge=0, le=1e3)]
Viscous = Annotated[float, Field(ge=0, le=1e3)]
Torque = Annotated[float, Field(ge=0, le=1e4)]
Backlash = Annotated[float, Field(ge=0, le=1)]
Stiffness = Annotated[float, Field(gt=0, le=1e9)]
Vibration = Annotated[float, Field(ge=0, le=1e4)]
DampingRatio = Annotated[float, Field(ge=0, le=10)]


def pair(found: Any) -> Any:  # noqa: ANN401 - whatever the file holds
    """Convert a list to a tuple, as pydantic's strict mode requires."""
    return tuple(found) if isinstance(found, list) else found


Place = Annotated[float, Field(ge=-1e6, le=1e6)]


def setting(
    default: Any,  # noqa: ANN401 - of the field's type
    meaning: str,
    unit: str = "",
    *,
    used_by: tuple[Kind, ...] = (),
    wanted: str = "",
    **limits: Any,  # noqa: ANN401 - as pydantic takes them
) -> Any:  # noqa: ANN401 - of the field's type
    """Declare a field.

    Args:
        default: Value if the configuration does not set the field.
        meaning: Meaning in words, for people.
        unit: Unit; empty: the field has none.
        used_by: Kinds of servo that use it; empty: all.
        wanted: Accepted values in words, without null; empty: by type and limits.
        limits: Bounds, as for pydantic's ``Field``.
    """
    extra: dict[str, Any] = {"unit": unit, "used_by": list(used_by), "wanted": wanted}
    return Field(default, description=meaning, json_schema_extra=extra, **limits)


class Section(BaseModel):
    """A part of the configuration: immutable, and without unknown fields."""

    model_config = ConfigDict(
        frozen=True, extra="forbid", strict=True, allow_inf_nan=False, validate_default=True
    )


class Loop(Section):
    """The fixed grid of ticks."""

    rate_hz: float = setting(1000.0, "Ticks per second", "Hz", ge=50, le=10_000)
    clock: Literal["monotonic", "simulated"] = setting(
        "monotonic",
        "monotonic: the system's clock; simulated: the same run, deterministic, as fast as the "
        "machine allows",
    )
    warm_up_s: float = setting(
        0.5,
        "Time at the start in which the loop measures the delay without torque, before the wall "
        "comes on",
        "s",
        ge=0,
        le=10,
    )


class Realtime(Section):
    """Real-time settings requested from Linux."""

    profile: Literal["off", "best-effort", "strict"] = setting(
        "best-effort",
        "off: request nothing; best-effort: use the granted settings and report the others; "
        "strict: refuse to start without all of them (default on real hardware)",
    )
    core: Whole | None = setting(
        None, "Processor core of the loop; null: chosen at the start", ge=0, le=1023
    )


class _Rendered(Section):
    """The settings that every law has."""

    stiffness: float = setting(
        8.0,
        "Requested stiffness K, of any size; the guard commands a stable one. Of another law: its "
        "steepest slope; a profile and a law of your own have their own slopes",
        "N·m/rad",
        ge=0,
        le=1e12,
    )
    damping: float = setting(
        0.0,
        "Virtual damping B on the estimated velocity; may be negative",
        "N·m·s/rad",
        ge=-1e12,
        le=1e12,
    )
    position: float = setting(
        0.0,
        "Position of the wall's surface, or zero of another law's positions; counted over turns "
        "from wall.reference",
        "rad",
        ge=-1000,
        le=1000,
    )
    reference: Literal["absolute", "start"] = setting(
        "absolute",
        "Zero of wall.position and safety.travel; absolute: the servo's own; start: position of "
        "the shaft at the start of the run",
    )
    torque_clip: Positive | None = setting(
        None,
        "Largest torque that the wall commands, spring and damper together; null: only "
        "servo.torque_limit applies. The quantisation limit does not depend on it",
        "N·m",
    )
    velocity_samples: Whole = setting(
        1, "Samples over which the velocity is a difference; 1: backward difference", ge=1, le=64
    )
    velocity_filter: Literal["none", "lowpass", "notch"] = setting(
        "none",
        "Filter of second order of the velocity that damps: lowpass or notch (both for two-sided "
        "walls; the guard counts their delay)",
    )
    velocity_hz: Positive = setting(
        100.0, "Corner of the low-pass, or middle of the notch; below half the rate", "Hz"
    )
    velocity_q: float = setting(
        0.7,
        "Quality of the filter: gain of the low-pass at its corner, or middle of the notch over "
        "its width",
        ge=0.1,
        le=20.0,
    )
    passivity_control: bool = setting(
        False, "Add damping when the wall has given more energy than it took"
    )


MOST_ROWS: Final = 4096
"""Most rows of a profile"""


def rows(found: Any) -> Any:  # noqa: ANN401 - whatever the file holds
    """Convert a list of pairs to tuples."""
    return tuple(map(pair, found)) if isinstance(found, list) else found


Row = tuple[Place, Place]


def _of(number: str) -> str:
    """Return whose number it is, for its description."""
    return f"Of {', '.join(name for name, kind in LAWS.items() if number in kind.numbers)}: "


class LawNumbers(Section):
    """A law and its own numbers; positions count from ``wall.position``."""

    law: str = setting(
        "wall",
        f"Rendered law: {', '.join(f'{name} ({kind.meaning})' for name, kind in LAWS.items())}, "
        f"{SUM} (of wall.parts), {NONE} (no torque), an installed law, or your own as module:Class",
        min_length=1,
        max_length=200,
    )
    side: Side = setting(
        "above",
        _of("side") + "above: fills the positions above and pushes down; below: fills those "
        "below and pushes up; both: two-sided, always in contact",
    )
    low: Place | None = setting(None, _of("low") + "the lower end of the free range", "rad")
    high: Place | None = setting(None, _of("high") + "the upper end of the free range", "rad")
    count: Whole | None = setting(None, _of("count") + "number in a turn", ge=1, le=1024)
    width: Positive | None = setting(
        None, _of("width") + "their distance, in place of wall.count", "rad"
    )
    snap: float = setting(
        0.25,
        _of("snap") + "position of the largest torque, as a fraction of their distance; a smaller "
        "value is firmer at the detent, a larger one releases more sharply",
        ge=0.05,
        le=0.45,
    )
    friction: Positive | None = setting(
        None, _of("friction") + "the torque at which it slips", "N·m"
    )
    period: Positive | None = setting(None, _of("period") + "the distance of its ridges", "rad")
    profile: Annotated[tuple[Row, ...] | None, BeforeValidator(rows)] = setting(
        None,
        _of("profile") + "a list of [position, torque]; linear in between, constant beyond its "
        "ends",
        wanted="a list of [position, torque]",
        max_length=MOST_ROWS,
    )
    options: dict[str, Any] = setting(
        {}, "Of a law of your own: the arguments of its class, by name"
    )


class Part(LawNumbers):
    """One law in a sum, with its share."""

    share: float = setting(1.0, "Stiffness of this part relative to the others", gt=0, le=1e3)

    @property
    def parts(self) -> tuple[Part, ...]:
        """Return an empty tuple: a part of a sum cannot be a sum."""
        return ()


class Wall(LawNumbers, _Rendered):
    """The requested law, a virtual wall by default; the guard decides the commanded one."""

    parts: Annotated[tuple[Part, ...], BeforeValidator(pair)] = setting(
        (),
        "Of sum: its laws, each a section with law, its numbers, and share: its stiffness relative "
        "to the others",
        wanted="a list of sections",
        max_length=16,
    )

    @property
    def acting_side(self) -> Side:
        """Return the side of a wall; ``both`` for every other law."""
        return self.side if self.law == "wall" else "both"


NUMBERS: Final = (*LawNumbers.model_fields, "parts")
"""Fields of ``wall`` that define its law"""


class Delay(Section):
    """Additional, inserted delay."""

    steps: Whole = setting(
        0, "Whole periods by which the wall's torque is delayed", "periods", ge=0, le=1000
    )


class Guard(Section):
    """Settings of the guard, which keeps the commanded wall stable."""

    mode: Literal["stable", "passive", "off"] = setting(
        "stable",
        "stable: below the stability limits; passive: stable with any passive hand too; off: "
        "command the requested wall (for experiments that search the boundary)",
    )
    margin: float = setting(
        0.8, "Largest fraction of the smallest limit that is commanded", gt=0, lt=1
    )
    damping_cap: float = setting(
        0.7, "Largest fraction of the damping ceiling that is commanded", gt=0, lt=1
    )
    quantisation_share: float = setting(
        0.1, "Fraction of the torque limit that one encoder count may command", gt=0, le=1
    )
    sample_age: BelievedLag = setting(
        0.0,
        "Least sample age that the guard counts, even if a smaller one is measured",
        "s",
    )


Number = TypeVar("Number")


class Estimate(Section, Generic[Number]):
    """A believed value and its bounds."""

    value: Number
    low: Number
    high: Number

    @model_validator(mode="before")
    @classmethod
    def _from_number(cls, found: Any) -> Any:  # noqa: ANN401 - whatever the file holds
        """Convert a bare number to an estimate whose bounds are the number itself."""
        if isinstance(found, (int, float)) and not isinstance(found, bool):
            return {"value": found, "low": found, "high": found}
        return found

    @model_validator(mode="after")
    def _ordered(self) -> Estimate[Number]:
        if not self.low <= self.value <= self.high:  # type: ignore[operator]
            raise ValueError("low <= value <= high")
        return self


class Model(Section):
    """The controller's belief about the servo; for a simulated servo it defaults to the truth."""

    inertia: Estimate[Inertia] | None = setting(
        None, "Believed inertia of everything that the servo turns, a link included", "kg·m²"
    )
    damping: Estimate[Viscous] | None = setting(None, "Believed viscous friction", "N·m·s/rad")
    coulomb: Estimate[Torque] | None = setting(
        None, "Believed Coulomb friction; the guard counts it as zero, reports show it", "N·m"
    )
    delay: Estimate[BelievedLag] | None = setting(
        None, "Believed lag, from sending a torque until it acts", "s"
    )
    current_bandwidth: Estimate[Bandwidth] | None = setting(
        None,
        "Believed bandwidth of the loop that controls the motor's current, where model.delay does "
        "not contain it: the guard adds its lag, 1 / (2 π f)",
        "Hz",
    )
    torque_gain: Estimate[Gain] | None = setting(
        None, "Believed acting torque per commanded torque; unset and simulated: 1"
    )
    backlash: Estimate[Backlash] | None = setting(
        None,
        "Believed backlash between shaft and encoder, full width; unset: the guard counts none, "
        "simulated or not",
        "rad",
    )
    load_inertia: Estimate[LoadInertia] | None = setting(
        None,
        "Part of model.inertia behind a flexible transmission, horn and link; unset and real: "
        "none, a rigid servo without a link is assumed",
        "kg·m²",
    )
    bare: bool = setting(
        False,
        "Whether model.inertia is that of the bare servo, and model.load_inertia is added to it; "
        "several axes: always true",
    )
    transmission_stiffness: Estimate[Stiffness] | None = setting(
        None,
        "Believed stiffness of gear train and horn; an unset model.flexible_hz follows from it and "
        "model.load_inertia",
        "N·m/rad",
    )
    flexible_hz: Estimate[Vibration] | None = setting(
        None, "Believed frequency at which that load vibrates, both ends free", "Hz"
    )
    flexible_damping_ratio: Estimate[DampingRatio] | None = setting(
        None, "Believed damping ratio of that vibration; unset and real: 0"
    )


class Safety(Section):
    """Limits that end a run with torque off."""

    max_speed: Positive | None = setting(
        None,
        "Speed of the shaft above which the run trips; null: 0.8 of the model's no-load speed if "
        "the wall drives the shaft, 3 times that speed for any motion (30 rad/s for emulated and "
        "simulated servos)",
        "rad/s",
    )
    engage: Literal["wait", "at-once"] = setting(
        "wait",
        "wait: the wall comes on where its spring is unloaded, and until then the run has no "
        "torque; at-once: at any position (simulated and emulated servos only)",
    )
    engage_torque: float | None = setting(
        None,
        "Elastic torque up to which a spring counts as unloaded, but at least that of two encoder "
        "counts; at most 0.1 on a real servo; null: 5 % of the servo's stall torque, at most 0.1",
        "N·m",
        gt=0,
        le=1e3,
    )
    travel: Annotated[tuple[Place, Place] | None, BeforeValidator(pair)] = setting(
        None,
        "Lowest and highest position of the shaft, counted over turns from wall.reference; outside "
        "of them the run trips; null: any position",
        "rad",
        wanted="a list of two numbers, low and high",
    )
    max_loss: float = setting(
        0.05, "Fraction of lost readings in the window that trips", gt=0, le=1
    )
    loss_window_s: float = setting(
        0.5, "Window in which lost readings are counted", "s", ge=0.05, le=60
    )
    max_silence_s: float = setting(
        0.015,
        "Time without a good reading that trips, once three in a row have failed; at most half of "
        "servo.watchdog_s",
        "s",
        gt=0,
        le=1.27,
    )
    max_missed: float = setting(
        0.2,
        "Largest fraction of the periods of half a second that may be missed; above it "
        "realtime.profile=strict trips, the other profiles lower stiffness and damping and warn",
        gt=0,
        le=1,
    )
    on_oscillation: Literal["reduce", "trip", "report"] = setting(
        "reduce",
        "Answer to a wall that oscillates by itself; reduce: reduce stiffness and damping until "
        "it decays; trip: end the run; report: only report it. With guard.mode off it always trips",
    )
    heartbeat_s: float = setting(
        0.1,
        "Silence of the loop after which the supervisor takes the bus and ends the torque",
        "s",
        ge=0.02,
        le=10,
    )
