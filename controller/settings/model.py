"""Defines the sections of the configuration: every field with unit, bounds and meaning."""

from __future__ import annotations

from typing import Annotated, Any, Generic, Literal, TypeVar

from pydantic import BaseModel, BeforeValidator, ConfigDict, Field, model_validator

from haptic_wall.controller.laws.wall import Side
from haptic_wall.controller.settings.profile_file import MOST_ROWS, profile_of
from haptic_wall.hw.settings import Kind


def whole(found: Any) -> Any:  # noqa: ANN401 - whatever the file holds
    """Convert a whole float such as ``4e6`` to an integer; return any other value unchanged."""
    return int(found) if isinstance(found, float) and found.is_integer() else found


Whole = Annotated[int, BeforeValidator(whole)]
Positive = Annotated[float, Field(gt=0, le=1e6)]
NotNegative = Annotated[float, Field(ge=0, le=1e6)]
Lag = Annotated[float, Field(ge=0, le=1)]
Gain = Annotated[float, Field(gt=0, le=10)]


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
    **limits: Any,  # noqa: ANN401 - as pydantic takes them
) -> Any:  # noqa: ANN401 - of the field's type
    """Declare a field.

    Args:
        default: Value if the configuration does not set the field.
        meaning: Meaning in words, for people.
        unit: Unit; empty: the field has none.
        used_by: Kinds of servo that use it; empty: all.
        limits: Bounds, as for pydantic's ``Field``.
    """
    extra: dict[str, Any] = {"unit": unit} if unit or used_by else {}
    if used_by:
        extra["used_by"] = list(used_by)
    return Field(default, description=meaning, json_schema_extra=extra or None, **limits)


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
        "The system's clock, or a simulated one: the same run, deterministic, as fast as the "
        "machine allows",
    )
    warm_up_s: float = setting(
        0.5,
        "How long the loop runs without torque and measures the delay before the wall is switched "
        "on",
        "s",
        ge=0,
        le=10,
    )


class Realtime(Section):
    """Real-time settings requested from Linux."""

    profile: Literal["off", "best-effort", "strict"] = setting(
        "best-effort",
        "off: ask for nothing; best-effort: take what is granted and report the rest; strict: "
        "refuse to start without it (default on real hardware)",
    )
    priority: Whole = setting(80, "SCHED_FIFO priority of the loop", ge=1, le=98)
    core: Whole | None = setting(
        None, "Processor core of the loop; null: chosen at the start", ge=0, le=1023
    )
    spin_us: float | None = setting(
        None,
        "How long before each deadline to stop sleeping and spin; null: measured at the start",
        "µs",
        ge=0,
        le=1000,
    )
    rehearse: bool = setting(
        True,
        "Run the tick on stand-ins shortly before each deadline, so that it is in the processor's "
        "caches: ticks get shorter, and the loop's core busier",
    )


class _Rendered(Section):
    """The settings that every law has."""

    stiffness: float = setting(
        8.0,
        "Stiffness K; any value may be asked for, the guard commands what is stable. Of another "
        "law it is the steepest slope; a profile and a law of your own bring theirs",
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
        "Where the surface is, or from where a law's positions count, itself counted over turns "
        "as wall.reference says",
        "rad",
        ge=-1000,
        le=1000,
    )
    reference: Literal["absolute", "start"] = setting(
        "absolute",
        "What wall.position and safety.travel count from: absolute: the servo's own zero, start: "
        "where the shaft stands when the run begins",
    )
    torque_clip: Positive | None = setting(
        None,
        "Largest torque that the wall commands, spring and damper together; null: only "
        "servo.torque_limit limits it. It is no part of the quantisation limit",
        "N·m",
    )
    velocity_samples: Whole = setting(
        1, "Samples the velocity is differenced over; 1: the backward difference", ge=1, le=64
    )
    velocity_filter: Literal["none", "lowpass", "notch"] = setting(
        "none",
        "Filter of the velocity that damps, of the second order: lowpass, notch (both for "
        "two-sided walls; the guard counts their delay)",
    )
    velocity_hz: Positive = setting(
        100.0, "Corner of the low-pass, or middle of the notch; below half the rate", "Hz"
    )
    velocity_q: float = setting(
        0.7,
        "Quality of the filter: the gain of the low-pass at its corner; the middle of the notch "
        "over its width",
        ge=0.1,
        le=20.0,
    )
    tank: float = setting(
        0.05,
        "Of a law of your own that depends on time: the most energy that it may have absorbed and "
        "not yet given",
        "J",
        ge=1e-3,
        le=10.0,
    )
    passivity_control: bool = setting(
        False, "Put damping in where the wall gives more energy than it took"
    )


def rows(found: Any) -> Any:  # noqa: ANN401 - whatever the file holds
    """Read a profile from a CSV file, or convert a list of pairs to tuples."""
    if isinstance(found, str):
        return profile_of(found)
    return tuple(map(pair, found)) if isinstance(found, list) else found


Row = tuple[Place, Place]


class LawNumbers(Section):
    """A law and its own numbers; positions count from ``wall.position``."""

    law: str = setting(
        "wall",
        "What is rendered: wall, stops (a wall at each end), spring, damper, detents, friction, "
        "texture (a grating), profile (torque over position), sum (of wall.parts), a law that is "
        "installed, or your own as module:Class",
        min_length=1,
        max_length=200,
    )
    side: Side = setting(
        "above",
        "Of the law wall; above: fills the positions above and pushes down; below: fills those "
        "below and pushes up; both: two-sided, always in contact",
    )
    low: Place | None = setting(None, "Of stops: the lower end of the free range", "rad")
    high: Place | None = setting(None, "Of stops: its upper end", "rad")
    count: Whole | None = setting(None, "Of detents: how many there are in a turn", ge=1, le=1024)
    width: Positive | None = setting(
        None, "Of detents: their distance, in place of wall.count", "rad"
    )
    snap: float = setting(
        0.25,
        "Of detents: where the torque peaks between two of them, as a fraction of their distance; "
        "a smaller one is firm at the detent, a larger one lets go sharply",
        ge=0.05,
        le=0.45,
    )
    friction: Positive | None = setting(None, "Of friction: the torque at which it slips", "N·m")
    period: Positive | None = setting(None, "Of texture: the distance of its ridges", "rad")
    profile: Annotated[tuple[Row, ...] | None, BeforeValidator(rows)] = setting(
        None,
        "Of profile: a CSV file with the columns position_rad and torque_nm, or a list of "
        "[position, torque]; straight in between, constant beyond its ends",
        max_length=MOST_ROWS,
    )
    options: dict[str, Any] = setting(
        {}, "Of a law of your own: the arguments of its class, by name"
    )


class Part(LawNumbers):
    """One law in a sum, with its share."""

    share: float = setting(1.0, "How stiff this part is beside the others", gt=0, le=1e3)

    @property
    def parts(self) -> tuple[Part, ...]:
        """Return an empty tuple: a part of a sum cannot be a sum."""
        return ()


class Wall(LawNumbers, _Rendered):
    """The requested law, a virtual wall by default; the guard decides the commanded one."""

    parts: Annotated[tuple[Part, ...], BeforeValidator(pair)] = setting(
        (),
        "Of sum: its laws, each a section with law, its numbers, and share: how stiff it is beside "
        "the others",
        max_length=16,
    )

    @property
    def acting_side(self) -> Side:
        """Return the side of a wall; ``both`` for every other law."""
        return self.side if self.law == "wall" else "both"


class Delay(Section):
    """Additional, inserted delay."""

    steps: Whole = setting(
        0, "Whole sampling periods the wall's torque is held back", "periods", ge=0, le=1000
    )


class Guard(Section):
    """Settings of the guard, which keeps the commanded wall stable."""

    mode: Literal["stable", "passive", "off"] = setting(
        "stable",
        "stable: below the stability limits; passive: toward any passive hand too; off: command "
        "what is asked (for experiments that look for the boundary)",
    )
    margin: float = setting(
        0.8, "Share of the smallest limit that is commanded at most", gt=0, lt=1
    )
    damping_cap: float = setting(
        0.7, "Share of the damping ceiling that is commanded at most", gt=0, lt=1
    )
    quantisation_share: float = setting(
        0.1, "Share of the torque limit that one encoder count may command", gt=0, le=1
    )
    delay_percentile: float = setting(
        90.0, "Which percentile of the measured sample age counts as delay", "%", ge=50, le=100
    )
    window_s: float = setting(1.0, "Over how long the percentile is taken", "s", ge=0.05, le=60)
    sample_age: Lag = setting(
        0.0,
        "Lower bound for the age of a sample when its torque is sent, whatever is measured",
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

    inertia: Estimate[Positive] | None = setting(
        None, "Believed inertia of everything that the servo turns, a link included", "kg·m²"
    )
    damping: Estimate[NotNegative] | None = setting(None, "Believed viscous friction", "N·m·s/rad")
    coulomb: Estimate[NotNegative] | None = setting(
        None, "Believed Coulomb friction; the guard counts it as zero, reports name it", "N·m"
    )
    delay: Estimate[Lag] | None = setting(
        None, "Believed lag from a torque being sent to its action", "s"
    )
    torque_gain: Estimate[Gain] | None = setting(
        None, "Believed torque that acts per torque commanded; unset and simulated: 1"
    )
    backlash: Estimate[NotNegative] | None = setting(
        None,
        "Believed backlash between shaft and encoder, full width; unset: the guard counts none, "
        "simulated or not",
        "rad",
    )
    load_inertia: Estimate[NotNegative] | None = setting(
        None,
        "The part of model.inertia that is behind a flexible transmission, horn and link; unset "
        "and real: none, a rigid servo without a link is assumed",
        "kg·m²",
    )
    transmission_stiffness: Estimate[Positive] | None = setting(
        None,
        "Believed stiffness of gear train and horn; where model.flexible_hz is unset that "
        "frequency follows from it and model.load_inertia",
        "N·m/rad",
    )
    flexible_hz: Estimate[NotNegative] | None = setting(
        None, "Believed frequency at which that load vibrates, both ends free", "Hz"
    )
    flexible_damping_ratio: Estimate[NotNegative] | None = setting(
        None, "Believed damping ratio of that vibration; unset and real: 0"
    )


class Safety(Section):
    """Limits that end a run with torque off."""

    max_speed: Positive | None = setting(
        None,
        "Faster than this trips, whoever moves the shaft; null: 0.8 of the model's no-load speed "
        "where the wall drives it, 3 times that speed for any motion (30 rad/s for emulated and "
        "simulated servos)",
        "rad/s",
    )
    engage: Literal["wait", "at-once"] = setting(
        "wait",
        "wait: the wall comes on only where its spring is unloaded, and until then the run goes "
        "on without torque; at-once: wherever the shaft is (simulated and emulated servos only)",
    )
    engage_torque: float | None = setting(
        None,
        "Elastic torque up to which a spring counts as unloaded, but never less than two encoder "
        "counts of it; at most 0.1 on a real servo; null: 5 % of the servo's stall torque, at "
        "most 0.1",
        "N·m",
        gt=0,
        le=1e3,
    )
    travel: Annotated[tuple[Place, Place] | None, BeforeValidator(pair)] = setting(
        None,
        "Lowest and highest position that the shaft may have, counted over turns as "
        "wall.reference says; beyond it trips; null: any",
        "rad",
    )
    max_loss: float = setting(
        0.05, "Share of lost readings within the window that trips", gt=0, le=1
    )
    loss_window_s: float = setting(
        0.5, "Over how long lost readings are counted", "s", ge=0.05, le=60
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
        "Fraction of the periods of half a second that may be missed; above it "
        "realtime.profile=strict trips, the others lower stiffness and damping and report it",
        gt=0,
        le=1,
    )
    on_oscillation: Literal["reduce", "trip", "report"] = setting(
        "reduce",
        "What is done when the wall oscillates by itself: reduce stiffness and damping until it "
        "decays, trip, or only report; with guard.mode off it always trips",
    )
    heartbeat_s: float = setting(
        0.1,
        "The supervisor takes the bus when the loop is silent for this long",
        "s",
        ge=0.02,
        le=10,
    )
