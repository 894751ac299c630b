"""The sections of the configuration: every field with its unit, its bounds and its meaning."""

from __future__ import annotations

from typing import Annotated, Any, Generic, Literal, TypeVar

from pydantic import BaseModel, BeforeValidator, ConfigDict, Field, model_validator

from haptic_wall.controller.laws.wall import Side


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


class Section(BaseModel):
    """A part of the configuration: immutable, and without unknown fields."""

    model_config = ConfigDict(
        frozen=True, extra="forbid", strict=True, allow_inf_nan=False, validate_default=True
    )


class Loop(Section):
    """The fixed grid of ticks."""

    rate_hz: float = Field(
        1000.0, ge=50, le=10_000, description="Ticks per second", json_schema_extra={"unit": "Hz"}
    )
    clock: Literal["monotonic", "simulated"] = Field(
        "monotonic",
        description="The system's clock, or a simulated one: the same run, deterministic, as "
        "fast as the machine allows",
    )
    warm_up_s: float = Field(
        0.5,
        ge=0,
        le=10,
        description="How long the loop runs without torque and measures the delay before the "
        "wall is switched on",
        json_schema_extra={"unit": "s"},
    )


class Realtime(Section):
    """Real-time settings requested from Linux."""

    profile: Literal["off", "best-effort", "strict"] = Field(
        "best-effort",
        description="off: ask for nothing; best-effort: take what is granted and report the "
        "rest; strict: refuse to start without it (default on real hardware)",
    )
    priority: Whole = Field(80, ge=1, le=98, description="SCHED_FIFO priority of the loop")
    core: Whole | None = Field(
        None, ge=0, le=1023, description="Processor core of the loop; null: chosen at the start"
    )
    spin_us: float | None = Field(
        None,
        ge=0,
        le=1000,
        description="How long before each deadline to stop sleeping and spin; null: measured at "
        "the start",
        json_schema_extra={"unit": "µs"},
    )
    rehearse: bool = Field(
        True,
        description="Run the tick on stand-ins shortly before each deadline, so that it is in the "
        "processor's caches: ticks get shorter, and the loop's core busier",
    )


class Wall(Section):
    """The requested virtual wall; the guard decides the commanded one."""

    stiffness: float = Field(
        8.0,
        ge=0,
        le=1e12,
        description="Stiffness K; any value may be asked for, the guard commands what is stable",
        json_schema_extra={"unit": "N·m/rad"},
    )
    damping: float = Field(
        0.0,
        ge=-1e12,
        le=1e12,
        description="Virtual damping B on the estimated velocity; may be negative",
        json_schema_extra={"unit": "N·m·s/rad"},
    )
    position: float = Field(
        0.0,
        ge=-1000,
        le=1000,
        description="Where the surface is, counted over turns as wall.reference says",
        json_schema_extra={"unit": "rad"},
    )
    reference: Literal["absolute", "start"] = Field(
        "absolute",
        description="What wall.position and safety.travel count from: absolute: the servo's own "
        "zero, start: where the shaft stands when the run begins",
    )
    side: Side = Field(
        "above",
        description="above: fills the positions above and pushes down; below: fills those below "
        "and pushes up; both: two-sided, always in contact",
    )
    torque_clip: Positive | None = Field(
        None,
        description="Largest torque that the wall commands, spring and damper together; null: "
        "only servo.torque_limit limits it. It is no part of the quantisation limit",
        json_schema_extra={"unit": "N·m"},
    )
    velocity_samples: Whole = Field(
        1,
        ge=1,
        le=64,
        description="Samples the velocity is differenced over; 1: the backward difference",
    )
    passivity_control: bool = Field(
        False,
        description="Put damping in where the wall gives more energy than it took",
    )


class Delay(Section):
    """Additional, inserted delay."""

    steps: Whole = Field(
        0,
        ge=0,
        le=1000,
        description="Whole sampling periods the wall's torque is held back",
        json_schema_extra={"unit": "periods"},
    )


class Guard(Section):
    """Settings of the guard, which keeps the commanded wall stable."""

    mode: Literal["stable", "passive", "off"] = Field(
        "stable",
        description="stable: below the stability limits; passive: toward any passive hand too; "
        "off: command what is asked (for experiments that look for the boundary)",
    )
    margin: float = Field(
        0.8, gt=0, lt=1, description="Share of the smallest limit that is commanded at most"
    )
    damping_cap: float = Field(
        0.7, gt=0, lt=1, description="Share of the damping ceiling that is commanded at most"
    )
    quantisation_share: float = Field(
        0.1,
        gt=0,
        le=1,
        description="Share of the torque limit that one encoder count may command",
    )
    delay_percentile: float = Field(
        90.0,
        ge=50,
        le=100,
        description="Which percentile of the measured sample age counts as delay",
        json_schema_extra={"unit": "%"},
    )
    window_s: float = Field(
        1.0,
        ge=0.05,
        le=60,
        description="Over how long the percentile is taken",
        json_schema_extra={"unit": "s"},
    )
    sample_age: Lag = Field(
        0.0,
        description="Lower bound for the age of a sample when its torque is sent, whatever is "
        "measured",
        json_schema_extra={"unit": "s"},
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

    inertia: Estimate[Positive] | None = Field(
        None, description="Believed inertia", json_schema_extra={"unit": "kg·m²"}
    )
    damping: Estimate[NotNegative] | None = Field(
        None, description="Believed viscous friction", json_schema_extra={"unit": "N·m·s/rad"}
    )
    coulomb: Estimate[NotNegative] | None = Field(
        None,
        description="Believed Coulomb friction; the guard counts it as zero, reports name it",
        json_schema_extra={"unit": "N·m"},
    )
    delay: Estimate[Lag] | None = Field(
        None,
        description="Believed lag from a torque being sent to its action",
        json_schema_extra={"unit": "s"},
    )
    torque_gain: Estimate[Gain] | None = Field(
        None,
        description="Believed torque that acts per torque commanded; unset and simulated: 1",
    )


class Safety(Section):
    """Limits that end a run with torque off."""

    max_speed: Positive | None = Field(
        None,
        description="Faster than this trips, whoever moves the shaft; null: 0.8 of the model's "
        "no-load speed where the wall drives it, 3 times that speed for any motion (30 rad/s for "
        "emulated and simulated servos)",
        json_schema_extra={"unit": "rad/s"},
    )
    engage: Literal["wait", "at-once"] = Field(
        "wait",
        description="wait: the wall comes on only where its spring is unloaded, and until then the "
        "run goes on without torque; at-once: wherever the shaft is (simulated and emulated "
        "servos only)",
    )
    engage_torque: float | None = Field(
        None,
        gt=0,
        le=1e3,
        description="Elastic torque up to which a spring counts as unloaded, but never less than "
        "two encoder counts of it; at most 0.1 on a real servo; null: 5 % of the servo's stall "
        "torque, at most 0.1",
        json_schema_extra={"unit": "N·m"},
    )
    travel: Annotated[tuple[Place, Place] | None, BeforeValidator(pair)] = Field(
        None,
        description="Lowest and highest position that the shaft may have, counted over turns as "
        "wall.reference says; beyond it trips; null: any",
        json_schema_extra={"unit": "rad"},
    )
    max_loss: float = Field(
        0.05, gt=0, le=1, description="Share of lost readings within the window that trips"
    )
    loss_window_s: float = Field(
        0.5,
        ge=0.05,
        le=60,
        description="Over how long lost readings are counted",
        json_schema_extra={"unit": "s"},
    )
    max_silence_s: float = Field(
        0.015,
        gt=0,
        le=1.27,
        description="Time without a good reading that trips, once three in a row have failed; at "
        "most half of servo.watchdog_s",
        json_schema_extra={"unit": "s"},
    )
    max_missed: float = Field(
        0.2,
        gt=0,
        le=1,
        description="Fraction of the periods of half a second that may be missed; above it "
        "realtime.profile=strict trips, the others lower stiffness and damping and report it",
    )
    on_oscillation: Literal["reduce", "trip", "report"] = Field(
        "reduce",
        description="What is done when the wall oscillates by itself: reduce stiffness and damping "
        "until it decays, trip, or only report; with guard.mode off it always trips",
    )
    heartbeat_s: float = Field(
        0.1,
        ge=0.02,
        le=10,
        description="The supervisor takes the bus when the loop is silent for this long",
        json_schema_extra={"unit": "s"},
    )
