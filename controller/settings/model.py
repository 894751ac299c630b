"""The sections of the configuration: every field with its unit, its bounds and its meaning."""

from __future__ import annotations

from typing import Annotated, Any, Generic, Literal, TypeVar

from pydantic import BaseModel, BeforeValidator, ConfigDict, Field, model_validator

from haptic_wall.controller.laws.wall import Side
from haptic_wall.hw.settings import Kind


def whole(found: Any) -> Any:  # noqa: ANN401 - whatever the file holds
    """Let ``4e6`` be a whole number; anything else is left for the validation to judge."""
    return int(found) if isinstance(found, float) and found.is_integer() else found


Whole = Annotated[int, BeforeValidator(whole)]
Positive = Annotated[float, Field(gt=0, le=1e6)]
NotNegative = Annotated[float, Field(ge=0, le=1e6)]
Lag = Annotated[float, Field(ge=0, le=1)]
Gain = Annotated[float, Field(gt=0, le=10)]


def pair(found: Any) -> Any:  # noqa: ANN401 - whatever the file holds
    """Let a list be what pydantic calls a tuple."""
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
        default: Value without a setting.
        meaning: For people.
        unit: Empty: it has none.
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


class Wall(Section):
    """The requested virtual wall; the guard decides the commanded one."""

    stiffness: float = setting(
        8.0,
        "Stiffness K; any value may be asked for, the guard commands what is stable",
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
        "Where the surface is, counted over turns as wall.reference says",
        "rad",
        ge=-1000,
        le=1000,
    )
    reference: Literal["absolute", "start"] = setting(
        "absolute",
        "What wall.position and safety.travel count from: absolute: the servo's own zero, start: "
        "where the shaft stands when the run begins",
    )
    side: Side = setting(
        "above",
        "above: fills the positions above and pushes down; below: fills those below and pushes "
        "up; both: two-sided, always in contact",
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
    passivity_control: bool = setting(
        False, "Put damping in where the wall gives more energy than it took"
    )


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
        """A bare number is believed without doubt."""
        if isinstance(found, (int, float)) and not isinstance(found, bool):
            return {"value": found, "low": found, "high": found}
        return found

    @model_validator(mode="after")
    def _ordered(self) -> Estimate[Number]:
        if not self.low <= self.value <= self.high:  # type: ignore[operator]
            raise ValueError("low <= value <= high")
        return self


class Model(Section):
    """The controller's belief about the servo; unset and simulated: the truth."""

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
