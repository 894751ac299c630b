"""The servo's section of the configuration: true parameters if simulated, connection if real."""

from __future__ import annotations

import math
from dataclasses import MISSING, fields
from typing import TYPE_CHECKING, Annotated, Any, Literal, get_args

from pydantic import (
    AfterValidator,
    BeforeValidator,
    Field,
    SerializerFunctionWrapHandler,
    create_model,
    model_serializer,
)

from haptic_wall.controller.settings.model import (
    Positive,
    Section,
    Whole,
    setting,
    whole,
)
from haptic_wall.hw.errors import is_emulated
from haptic_wall.hw.open import torque_models
from haptic_wall.hw.settings import (
    EMULATED,
    BackendName,
    Schedule,
    ServoSettings,
)
from haptic_wall.hw.truth import NUMBERS, TYPES, About, Kind, TrueServo, vibration

Baud = Annotated[
    Literal[9600, 57600, 115200, 1_000_000, 2_000_000, 3_000_000, 4_000_000, 4_500_000],
    BeforeValidator(whole),
]
"""Values of the Baud Rate register of the X series. Source: ROBOTIS e-manual."""


def _listed(found: Any) -> Any:  # noqa: ANN401 - whatever the file holds
    """Return the faults of a text, parted at blanks, or of a list."""
    if isinstance(found, str):
        return tuple(found.split())
    return tuple(found) if isinstance(found, list) else found


Port = Annotated[str, Field(pattern=r"^[^\x00]+$")]


def _sign(found: int) -> int:
    if not found:
        raise ValueError("1 or -1")
    return found


def used_by(name: str) -> tuple[str, ...]:
    """Return the kinds of servo that use a field of this section; by default all."""
    extra = Servo.model_fields[name].json_schema_extra
    kinds = extra["used_by"] if isinstance(extra, dict) else None
    return tuple(map(str, kinds)) if isinstance(kinds, list) and kinds else get_args(Kind)


_BUS: tuple[Kind, ...] = ("emulated", "hardware")
_EMULATED: tuple[Kind, ...] = ("emulated",)


class _Named(Section):
    """Comes before the other fields."""

    backend: BackendName = setting(
        "simulated", "Kind of servo; simulated: in this process; dynamixel: on a bus"
    )


def _declared(about: About, kind: Any, default: Any) -> tuple[Any, Any]:  # noqa: ANN401
    """Return a true parameter as a field; one without a default is null on hardware."""
    if default is MISSING:
        kind, default = kind | None, None
    low = "gt" if about.above else "ge"
    limits: dict[str, Any] = {low: about.low, "le": about.high} if kind in NUMBERS else {}
    field = setting(default, about.meaning, about.unit, used_by=about.kinds, **limits)
    return Whole if kind is int else kind, field


def truth_section(truth: Any, base: type[Section], prefix: str = "") -> Any:  # noqa: ANN401
    """Return a section with the fields of a truth that a configuration has.

    Args:
        truth: Its dataclass.
        base: The section with the fields before these.
        prefix: Of its paths in ``TYPES``.
    """
    about = {each: each.metadata["about"] for each in fields(truth)}
    declared: dict[str, Any] = {
        each.name: _declared(found, TYPES[prefix + each.name], each.default)
        for each, found in about.items()
        if found.kinds
    }
    return create_model("_Truth", __base__=base, __module__=__name__, **declared)


if TYPE_CHECKING:

    class _Truth(_Named, TrueServo):
        """The fields of ``TrueServo`` that a configuration has."""

else:
    _Truth = truth_section(TrueServo, _Named)


class Servo(_Truth):
    """The servo: true parameters if simulated or emulated, connection if real."""

    faults: Annotated[tuple[str, ...], BeforeValidator(_listed)] = setting(
        (),
        "Faults to inject into the emulated bus, as for haptic-wall emulate --fault, e.g. "
        "drop:p=0.01; several as a list, or in one text with blanks between them",
        used_by=_EMULATED,
        wanted="a list of texts",
    )
    fault_seed: Whole = setting(0, "Seed of the faults", ge=0, le=2**32, used_by=_EMULATED)
    kick: float | None = setting(
        None,
        "Displacement from wall.position at the start, positive toward positive positions; up to a "
        "quarter turn the wall comes on at once; null: 0.1 rad outside a one-sided wall, 0 on a "
        "two-sided one",
        "rad",
        ge=-100,
        le=100,
        used_by=("simulated", "emulated"),
    )
    torque_limit: Positive | None = setting(  # type: ignore[assignment]  # or null
        None,
        "Largest torque: saturation of a simulated servo (null: 4.1); on a bus a limit of the "
        "driver below the servo's own (null: the servo's Current Limit)",
        "N·m",
    )
    torque_constant: Positive | None = setting(  # type: ignore[assignment]  # or null
        None,
        "Torque per current: the truth of an emulated servo, a calibration of a real one; null: "
        "the model's stall torque over its stall current",
        "N·m/A",
        used_by=_BUS,
    )
    port: Port | None = setting(
        None,
        "Serial device, e.g. /dev/ttyUSB0; emulated: an emulated bus that the run starts",
        min_length=1,
        used_by=_BUS,
    )
    baud: Baud | None = setting(None, "Baud rate of the bus", "bit/s", used_by=_BUS)
    id: Whole = setting(1, "The servo's id on the bus", ge=0, le=252, used_by=_BUS)
    model: str | None = setting(
        None, "The servo's model, e.g. XM430-W350", min_length=1, used_by=_BUS
    )
    schedule: Literal[Schedule, "auto"] = setting(
        "auto",
        "immediate: request and reply in one tick; pipelined: the reply travels while the loop "
        "sleeps, and its age is counted; auto: pipelined if the start-up measures replies that an "
        "adapter holds back for longer than immediate waits, else immediate",
        used_by=_BUS,
    )
    watchdog_s: float = setting(
        0.04,
        "Bus Watchdog: time without a message after which the servo drops its torque",
        "s",
        ge=0.02,
        le=2.54,
        multiple_of=0.02,
        used_by=_BUS,
    )
    probe_torque: float = setting(
        0.3,
        "Largest torque of the probe that proves the torque's sign at the start; 0: no probe",
        "N·m",
        ge=0,
        le=5,
        used_by=_BUS,
    )
    sign: Annotated[Whole, AfterValidator(_sign)] = setting(
        1,
        "Direction of its positions and torques; 1: the servo's own; -1: opposite",
        ge=-1,
        le=1,
    )
    offset: float = setting(
        0.0,
        "Added to its position: position = sign * the servo's own + offset",
        "rad",
        ge=-1000,
        le=1000,
    )

    @property
    def is_emulated(self) -> bool:
        """Whether an emulator, not an adapter, is at the other end of the port."""
        if self.kind != "hardware":
            return self.kind == "emulated"
        return self.port is not None and is_emulated(self.port)

    @property
    def kind(self) -> Kind:
        """Return the kind of servo behind the servo interface."""
        if self.backend == "simulated":
            return "simulated"
        return "emulated" if self.port == EMULATED else "hardware"

    @property
    def position_step(self) -> float:
        """Return the encoder count that is expected [rad]; 0: the position is not quantised.

        It cannot be configured for a real servo; then it is that of a Dynamixel.
        """
        return math.tau / self.counts_per_rev if self.counts_per_rev else 0.0

    @property
    def current_lag(self) -> float:
        """Return the true delay that the loop of current control adds at most [s]."""
        bandwidth = self.current_bandwidth
        lag = 1.0 / (math.tau * bandwidth) if bandwidth else 0.0
        return self.current_period + lag

    @property
    def flexible_hz(self) -> float:
        """Return the true frequency at which the load vibrates, both ends free [Hz]; 0: rigid."""
        return vibration(self).rate / math.tau

    @property
    def flexible_damping_ratio(self) -> float:
        """Return the true damping ratio of that vibration."""
        return vibration(self).ratio

    @property
    def hides_constant(self) -> bool:
        """Whether ``torque_constant`` is kept from the driver, which takes the data sheet's.

        It is the truth of an emulated servo. Of a model without published figures the driver knows
        no other.
        """
        model = torque_models().get(self.model or "")
        return self.kind == "emulated" and (model is None or model.torque_constant is not None)

    def asked(self) -> ServoSettings:
        """Return this section as the backend's settings."""
        return ServoSettings(
            backend=self.backend,
            port=self.port or "",
            baud=self.baud or 0,
            id=self.id,
            model=self.model or "",
            torque_constant=0.0 if self.hides_constant else self.torque_constant or 0.0,
            torque_limit=self.torque_limit or 0.0,
            watchdog_s=self.watchdog_s,
            probe_torque=self.probe_torque,
            sign=self.sign,
            offset=self.offset,
            faults=self.faults,
            fault_seed=self.fault_seed,
        )

    @model_serializer(mode="wrap")
    def _without_the_truth_of_hardware(
        self, handler: SerializerFunctionWrapHandler
    ) -> dict[str, Any]:
        """Drop the fields of simulated servos: a real one's true parameters are unknown."""
        fields: dict[str, Any] = handler(self)
        if self.kind == "hardware":
            fields = {name: value for name, value in fields.items() if name not in TRUTH_FIELDS}
        return fields


TRUTH_FIELDS = tuple(name for name in Servo.model_fields if "hardware" not in used_by(name))
"""The fields with the true parameters of a simulated or emulated servo."""
