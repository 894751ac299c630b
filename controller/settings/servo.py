"""The servo's section of the configuration: true parameters if simulated, connection if real."""

from __future__ import annotations

import math
from functools import cache
from typing import Annotated, Any, Literal, get_args

from pydantic import (
    AfterValidator,
    BeforeValidator,
    Field,
    SerializerFunctionWrapHandler,
    TypeAdapter,
    model_serializer,
)

from haptic_wall.controller.settings.model import (
    Backlash,
    Inertia,
    Lag,
    LoadInertia,
    NotNegative,
    Place,
    Positive,
    Section,
    Torque,
    Viscous,
    Whole,
    pair,
    setting,
    whole,
)
from haptic_wall.controller.settings.refusal import refusal
from haptic_wall.hw.errors import BackendError, Problem, is_emulated
from haptic_wall.hw.names import did_you_mean
from haptic_wall.hw.open import backend, backend_names
from haptic_wall.hw.settings import (
    EMULATED,
    LEAST_STRIBECK_EXPONENT,
    MOST_LINKS,
    MOST_LOAD_FRICTION,
    MOST_STRIBECK_EXPONENT,
    MOST_TORQUE_RIPPLE,
    EncoderSide,
    HandName,
    Kind,
    Link,
    Schedule,
    ServoSettings,
    Vibration,
    vibrations,
)

Baud = Annotated[
    Literal[9600, 57600, 115200, 1_000_000, 2_000_000, 3_000_000, 4_000_000, 4_500_000],
    BeforeValidator(whole),
]
"""Values of the Baud Rate register of the X series. Source: ROBOTIS e-manual."""


def _listed(found: Any) -> Any:  # noqa: ANN401 - whatever the file holds
    """Let one text be a list of its words, and a list be what pydantic calls a tuple."""
    if isinstance(found, str):
        return tuple(found.split())
    return tuple(found) if isinstance(found, list) else found


def _links(found: Any) -> Any:  # noqa: ANN401 - whatever the file holds
    """Convert a list of rows to tuples, as pydantic's strict mode requires."""
    return tuple(map(pair, found)) if isinstance(found, list) else found


def _port(found: str) -> str:
    """Refuse impossible device names and misspellings of ``emulated``."""
    if "\0" in found or (found != EMULATED and found.strip().lower() == EMULATED):
        raise refusal(
            Problem(f"found {found!r}", wanted="a serial device such as /dev/ttyUSB0, or emulated")
        )
    return found


def _backend(found: str) -> str:
    """Raise if no backend has this name, or if it cannot be loaded."""
    try:
        backend(found)
    except BackendError as error:
        names = backend_names()
        wanted, near = f"one of {', '.join(names)}", did_you_mean(found, names)
        problem = Problem(f"found {found!r}", wanted=wanted, advice=near)
        raise refusal(Problem(str(error).rstrip(".")) if found in names else problem) from error
    return found


def used_by(name: str) -> tuple[str, ...]:
    """Return the kinds of servo that use a field of this section; by default all."""
    extra = Servo.model_fields[name].json_schema_extra
    kinds = extra.get("used_by") if isinstance(extra, dict) else None
    return tuple(map(str, kinds)) if isinstance(kinds, list) else get_args(Kind)


_ANY: tuple[Kind, ...] = ("simulated", "emulated", "hardware")
_TRUTH: tuple[Kind, ...] = ("simulated", "emulated")
_BUS: tuple[Kind, ...] = ("emulated", "hardware")
_EMULATED: tuple[Kind, ...] = ("emulated",)


LinkRow = tuple[Positive, Annotated[float, Field(gt=0, le=1e9)], NotNegative]
"""Inertia, stiffness and damping of a link"""


class Servo(Section):
    """The servo: true parameters if simulated or emulated, connection if real."""

    backend: Annotated[str, AfterValidator(_backend)] = setting(
        "simulated",
        "Kind of servo; simulated: in this process; dynamixel: on a bus; or the name of an "
        "installed plugin",
    )
    inertia: Inertia | None = setting(None, "True inertia", "kg·m²", used_by=_TRUTH)
    damping: Viscous = setting(0.0, "True viscous friction", "N·m·s/rad", used_by=_TRUTH)
    coulomb: Torque = setting(0.0, "True Coulomb friction", "N·m", used_by=_TRUTH)
    counts_per_rev: Whole = setting(
        4096,
        "Encoder counts per revolution; 0: the position is not quantised",
        "counts/rev",
        ge=0,
        le=2**24,
        used_by=_TRUTH,
    )
    delay: Lag = setting(
        0.0, "True lag, from a torque's arrival at the servo until it acts", "s", used_by=_TRUTH
    )
    torque_step: NotNegative = setting(
        0.0,
        "Step to which torques are rounded; 0: not rounded (an emulated servo rounds to its "
        "current unit)",
        "N·m",
        used_by=("simulated",),
    )
    backlash: Backlash = setting(
        0.0,
        "True backlash, full width: between shaft and encoder, or with a transmission between "
        "motor and output",
        "rad",
        used_by=_TRUTH,
    )
    load_inertia: LoadInertia = setting(
        0.0,
        "True inertia of the output behind a flexible transmission; servo.inertia and friction are "
        "then the motor's; 0: rigid",
        "kg·m²",
        used_by=_TRUTH,
    )
    transmission_stiffness: float = setting(
        0.0, "True stiffness of that transmission", "N·m/rad", ge=0, le=1e9, used_by=_TRUTH
    )
    transmission_damping: NotNegative = setting(
        0.0, "True damping of that transmission", "N·m·s/rad", used_by=_TRUTH
    )
    chain: Annotated[tuple[LinkRow, ...], BeforeValidator(_links)] = setting(
        (),
        "True masses behind the output, each a list of its inertia [kg·m²] and of the stiffness "
        "[N·m/rad] and damping [N·m·s/rad] of its joint to the mass before",
        max_length=MOST_LINKS,
        used_by=_TRUTH,
    )
    encoder: EncoderSide = setting(
        "output", "Side of a flexible transmission that the encoder measures", used_by=_ANY
    )
    current_bandwidth: float = setting(
        0.0,
        "True bandwidth of the loop that controls the motor's current, first order; 0: the torque "
        "follows at once",
        "Hz",
        ge=0,
        le=1e4,
        used_by=_TRUTH,
    )
    current_period: float = setting(
        0.0,
        "True period of that loop, which accepts a goal at multiples of it; 0: at once",
        "s",
        ge=0,
        le=0.01,
        used_by=_TRUTH,
    )
    dead_band: NotNegative = setting(
        0.0,
        "True dead band: the motor makes this much less torque than commanded, and none below it",
        "N·m",
        used_by=_TRUTH,
    )
    back_emf: bool = setting(
        False,
        "Whether the true torque in current mode falls with the speed: by the limit of the supply, "
        "and by servo.current_droop",
        used_by=_TRUTH,
    )
    current_droop: float = setting(
        0.0,
        "Fraction of the back-EMF that the true current loop leaves uncorrected at the no-load "
        "speed, less in proportion below; with servo.back_emf",
        ge=0,
        le=1,
        used_by=_TRUTH,
    )
    no_load_speed: Positive = setting(
        4.82,
        "True no-load speed of a simulated servo with servo.back_emf, whose stall torque is "
        "servo.torque_limit; an emulated one has its model's",
        "rad/s",
        used_by=("simulated",),
    )
    current_filter: float = setting(
        0.0,
        "True bandwidth of the measured current's filter, first order; 0: not filtered",
        "Hz",
        ge=0,
        le=1e4,
        used_by=_EMULATED,
    )
    current_offset: float = setting(
        0.0, "True offset of the measured current", "A", ge=-10, le=10, used_by=_EMULATED
    )
    static_friction: NotNegative = setting(
        0.0,
        "True torque up to which the shaft stays at rest, at least servo.coulomb; 0: "
        "servo.coulomb. Published fits: 1.4 to 3.8 times the friction in motion",
        "N·m",
        used_by=_TRUTH,
    )
    stribeck_speed: float = setting(
        0.0,
        "True speed over which the excess of the static friction falls by a factor e; 0: the "
        "excess ends as soon as the shaft moves. Published fits: 0.75 to 4.2",
        "rad/s",
        ge=0,
        le=100,
        used_by=_TRUTH,
    )
    stribeck_exponent: float = setting(
        1.0,
        "Exponent of that fall. Published fits: 0.76 to 8.7",
        ge=LEAST_STRIBECK_EXPONENT,
        le=MOST_STRIBECK_EXPONENT,
        used_by=_TRUTH,
    )
    damping_back: Viscous | None = setting(
        None,
        "True viscous friction at negative velocities; null: servo.damping",
        "N·m·s/rad",
        used_by=_TRUTH,
    )
    load_friction: float = setting(
        0.0,
        "True fraction of the load on the gear (motor's less external torque) that adds to the "
        "friction. Published fits: 0.07 to 0.22",
        ge=0,
        le=MOST_LOAD_FRICTION,
        used_by=_TRUTH,
    )
    load_friction_external: float | None = setting(
        None,
        "True fraction for the external torque in that load; null: servo.load_friction for both",
        ge=0,
        le=MOST_LOAD_FRICTION,
        used_by=_TRUTH,
    )
    load_friction_at_rest: float = setting(
        0.0,
        "True addition to servo.load_friction at rest, which falls with the speed as the excess of "
        "servo.static_friction does. Published fits: 0 to 0.23",
        ge=0,
        le=MOST_LOAD_FRICTION,
        used_by=_TRUTH,
    )
    load_friction_at_rest_external: float | None = setting(
        None,
        "The same for the external torque; null: servo.load_friction_at_rest for both",
        ge=0,
        le=MOST_LOAD_FRICTION,
        used_by=_TRUTH,
    )
    load_friction_square: float = setting(
        0.0,
        "True friction at rest over the square of the motor's torque, while a larger external "
        "torque opposes it. Published fits: 0 to 0.01",
        "1/(N·m)",
        ge=0,
        le=10,
        used_by=_TRUTH,
    )
    load_friction_square_external: float = setting(
        0.0,
        "True friction at rest over the square of the external torque, while a larger torque of "
        "the motor opposes it. Published fits: 0 to 0.01",
        "1/(N·m)",
        ge=0,
        le=10,
        used_by=_TRUTH,
    )
    gravity: NotNegative = setting(
        0.0, "True torque of a weight on a horizontal link", "N·m", used_by=_TRUTH
    )
    gravity_angle: Place = setting(
        0.0, "Position at which that weight hangs", "rad", used_by=_TRUTH
    )
    cogging: NotNegative = setting(
        0.0, "True amplitude of a torque that alternates with the position", "N·m", used_by=_TRUTH
    )
    cogging_periods: float = setting(
        24.0, "Periods of the cogging a turn", ge=0.1, le=10_000, used_by=_TRUTH
    )
    cogging_phase: Place = setting(0.0, "Phase of the cogging at position 0", "rad", used_by=_TRUTH)
    torque_ripple: float = setting(
        0.0,
        "True fraction by which the motor's torque varies with the position",
        ge=0,
        le=MOST_TORQUE_RIPPLE,
        used_by=_TRUTH,
    )
    torque_ripple_periods: float = setting(
        24.0, "Periods of the ripple a turn", ge=0.1, le=10_000, used_by=_TRUTH
    )
    torque_ripple_phase: Place = setting(
        0.0, "Phase of the ripple at position 0", "rad", used_by=_TRUTH
    )
    encoder_eccentricity: float = setting(
        0.0,
        "True amplitude of the encoder's error once a turn",
        "rad",
        ge=0,
        le=0.5,
        used_by=_TRUTH,
    )
    encoder_phase: Place = setting(
        0.0, "Phase of the encoder's error at position 0", "rad", used_by=_TRUTH
    )
    encoder_noise: float = setting(
        0.0,
        "True noise of the encoder before it rounds, standard deviation",
        "counts",
        ge=0,
        le=1000,
        used_by=_TRUTH,
    )
    noise_seed: Whole = setting(0, "Seed of the noise", ge=0, le=2**32, used_by=_TRUTH)
    supply: float | None = setting(
        None,
        "True voltage of the supply; null: nominal voltage of its model",
        "V",
        ge=1,
        le=60,
        used_by=_EMULATED,
    )
    ambient: float = setting(
        32.0,
        "True temperature of the idle servo",
        "°C",
        ge=-40,
        le=200,
        used_by=_EMULATED,
    )
    faults: Annotated[tuple[str, ...], BeforeValidator(_listed)] = setting(
        (),
        "Faults to inject into the emulated bus, as for haptic-wall emulate --fault, e.g. "
        "drop:p=0.01; several as a list, or in one text with blanks between them",
        used_by=_EMULATED,
    )
    fault_seed: Whole = setting(0, "Seed of the faults", ge=0, le=2**32, used_by=_EMULATED)
    hand: HandName = setting(
        "none",
        "Scripted hand: push, slowly in and out of the wall; tap; lean, a steady push in the "
        "positive direction",
        used_by=_TRUTH,
    )
    kick: float | None = setting(
        None,
        "Displacement from wall.position at the start, positive toward positive positions; up to a "
        "quarter turn the wall comes on at once; null: 0.1 rad outside a one-sided wall, 0 on a "
        "two-sided one",
        "rad",
        ge=-100,
        le=100,
        used_by=_TRUTH,
    )
    torque_limit: Positive | None = setting(
        None,
        "Largest torque: saturation of a simulated servo (null: 4.1); on a bus a limit of the "
        "driver below the servo's own (null: the servo's Current Limit)",
        "N·m",
        used_by=_ANY,
    )
    torque_constant: Positive | None = setting(
        None,
        "Torque per current: the truth of an emulated servo, a calibration of a real one; null: "
        "the model's stall torque over its stall current",
        "N·m/A",
        used_by=_BUS,
    )
    port: Annotated[str, AfterValidator(_port)] | None = setting(
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
    schedule: Schedule | Literal["auto"] = setting(
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

    options: dict[str, Any] = setting({}, "Settings of a plugin's backend, by name")

    @property
    def is_emulated(self) -> bool:
        """Whether an emulator, not an adapter, is at the other end of the port."""
        if self.kind != "hardware":
            return self.kind == "emulated"
        return self.port is not None and is_emulated(self.port)

    @property
    def kind(self) -> Kind:
        """Return the kind of servo behind the servo interface."""
        return backend(self.backend).kind(self.port)

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
        """Return the true frequency at which the load vibrates, both ends free [Hz]; 0: rigid.

        It is that of the slowest vibration of a chain.
        """
        return self._vibration.rate / math.tau

    @property
    def flexible_damping_ratio(self) -> float:
        """Return the true damping ratio of that vibration."""
        return self._vibration.ratio

    @property
    def behind(self) -> float:
        """Return the true inertia of everything behind the transmission [kg·m²]."""
        return sum((inertia for inertia, _, _ in self.chain), self.load_inertia)

    @property
    def links(self) -> tuple[Link, ...]:
        """Return the output and the masses behind it."""
        output = Link(self.load_inertia, self.transmission_stiffness, self.transmission_damping)
        return output, *(Link(*row) for row in self.chain)

    @property
    def _vibration(self) -> Vibration:
        if not self.inertia or not self.load_inertia or not self.transmission_stiffness:
            return Vibration(0.0, 0.0)
        return vibrations(self.inertia, self.links)[0]

    @property
    def hides_constant(self) -> bool:
        """Whether ``torque_constant`` is kept from the driver, which takes the data sheet's.

        It is the truth of an emulated servo. Of a model without published figures the driver knows
        no other.
        """
        known = backend(self.backend).models
        model = known().get(self.model or "") if known is not None else None
        return self.kind == "emulated" and (model is None or model.constant_known)

    def asked(self) -> ServoSettings:
        """Return this section as the backend's settings.

        Raises:
            ValidationError: An option is unknown, missing or wrong.
        """
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
            faults=self.faults,
            fault_seed=self.fault_seed,
            options=options_of(self),
        )

    @model_serializer(mode="wrap")
    def _without_the_truth_of_hardware(
        self, handler: SerializerFunctionWrapHandler
    ) -> dict[str, Any]:
        """Drop the fields of simulated servos: a real one's true parameters are unknown."""
        fields: dict[str, Any] = handler(self)
        if not self.options:
            fields.pop("options", None)
        if self.kind == "hardware":
            fields = {name: value for name, value in fields.items() if name not in TRUTH_FIELDS}
        return fields


def options_of(servo: Servo) -> Any:  # noqa: ANN401 - whatever the backend declares
    """Return the backend's own settings, as an instance of its ``options``.

    Raises:
        ValidationError: An option is unknown, missing or wrong.
    """
    return _options(backend(servo.backend).options).validate_python(servo.options)


@cache
def _options(model: type) -> TypeAdapter[Any]:
    return TypeAdapter(model)


TRUTH_FIELDS = tuple(name for name in Servo.model_fields if "hardware" not in used_by(name))
"""The fields with the true parameters of a simulated or emulated servo."""
