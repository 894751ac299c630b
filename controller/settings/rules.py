"""Checks the rules between fields; each rule names the field at fault."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator
from contextlib import suppress
from dataclasses import fields, is_dataclass, replace

from pydantic import ValidationError

from haptic_wall.controller.laws import own
from haptic_wall.controller.laws.engagement import MOST_TORQUE
from haptic_wall.controller.laws.shape import Grid, LawError
from haptic_wall.controller.laws.table import LAWS, SUM, shape_of
from haptic_wall.controller.settings.model import MOST_LAG, LawNumbers, Wall
from haptic_wall.controller.settings.sections import Sections
from haptic_wall.controller.settings.servo import TRUTH_FIELDS, options_of
from haptic_wall.controller.settings.shares import SPIN_SHARE
from haptic_wall.hw.errors import Problem
from haptic_wall.hw.names import did_you_mean
from haptic_wall.hw.open import backend
from haptic_wall.hw.truth import disagreements, vibration

Rule = Callable[[Sections], Iterator[Problem]]


class BrokenRulesError(ValueError):
    """Raised if fields are valid by themselves, but not together."""

    def __init__(self, problems: list[Problem]) -> None:
        super().__init__("; ".join(map(str, problems)))
        self.problems = problems


MOST_OF_RATE = 0.45
"""Highest frequency of a filter of the velocity, as a fraction of the rate"""
MOST_LOWPASS_Q = 0.7072
"""Quality of a low-pass of the velocity above which its gain exceeds 1"""
WIDEST_NOTCHED_HZ = 60.0
"""Widest range of a vibration's believed frequency with a notch [Hz]; the start already takes
seconds"""
_RULES: list[Rule] = []
_MOST_PERIODS = 5000
"""Longest delay [periods]; the theory counts contacts up to 10,000 late"""


def _rule(check: Rule) -> Rule:
    _RULES.append(check)
    return check


def broken_rules(config: Sections) -> list[Problem]:
    """Return the violations of all rules between fields, each of which is valid by itself."""
    return [problem for rule in _RULES for problem in rule(config)]


def _is_real(config: Sections) -> bool:
    """Whether the servo is real; another rule reports a missing port."""
    return config.servo.kind == "hardware" and config.servo.port is not None


@_rule
def _truth_is_given(config: Sections) -> Iterator[Problem]:
    if config.servo.kind != "hardware" and config.servo.inertia is None:
        yield Problem(
            "found nothing",
            field="servo.inertia",
            wanted=f"the inertia of the {config.servo.kind} servo [kg·m²] above 0",
        )


@_rule
def _truth_is_not_ours_to_say(config: Sections) -> Iterator[Problem]:
    if not _is_real(config):
        return
    for name in TRUTH_FIELDS:
        if name in config.servo.model_fields_set:
            belief = f"set the belief model.{name} instead" if name in _BELIEVED else "leave it out"
            yield Problem(
                f"found {getattr(config.servo, name)!r}, but only simulated and emulated servos "
                f"have this setting, and servo.port {config.servo.port} is a real one",
                advice=belief,
                field=f"servo.{name}",
            )


_BELIEVED = ("inertia", "damping", "coulomb", "delay", "torque_gain")


@_rule
def _hardware_is_believed_something(config: Sections) -> Iterator[Problem]:
    if not _is_real(config):
        return
    for name in _BELIEVED:
        if getattr(config.model, name) is None:
            yield Problem(
                "found nothing",
                field=f"model.{name}",
                wanted="a number or {value, low, high}: the controller knows a real servo only "
                "from the configuration",
            )


@_rule
def _required_is_given(config: Sections) -> Iterator[Problem]:
    name = config.servo.backend
    for field, wanted in backend(name).required.items():
        if getattr(config.servo, field) is None:
            yield Problem(
                "found nothing",
                field=f"servo.{field}",
                wanted=f"{wanted} (servo.backend is {name})",
            )


@_rule
def _options_are_the_backends(config: Sections) -> Iterator[Problem]:
    name, given = config.servo.backend, config.servo.options
    model = backend(name).options
    if is_dataclass(model):
        known = [field.name for field in fields(model)]
        for option in given:
            if option not in known:
                hint = did_you_mean(option, known, "servo.options.")
                yield Problem(
                    "; ".join(filter(None, ("unknown", hint))),
                    field=f"servo.options.{option}",
                    advice=f"the backend {name} has {', '.join(known) or 'no options'}",
                )
    try:
        options_of(config.servo)
    except ValidationError as error:
        for detail in error.errors():
            path = ".".join(("servo.options", *map(str, detail["loc"])))
            yield Problem(f"{detail['msg'].lower()} (servo.backend is {name})", field=path)


@_rule
def _real_time_for_real_servos(config: Sections) -> Iterator[Problem]:
    if _is_real(config) and config.loop.clock == "simulated":
        yield Problem(
            "found simulated",
            field="loop.clock",
            wanted=f"monotonic: the servo at {config.servo.port} is real",
        )


@_rule
def _real_walls_wait(config: Sections) -> Iterator[Problem]:
    if _is_real(config) and config.safety.engage == "at-once":
        yield Problem(
            "found at-once",
            field="safety.engage",
            wanted=f"wait: the servo at {config.servo.port} is real, and a wall that comes "
            "on around its shaft strikes the hand that holds it",
        )


@_rule
def _real_walls_come_on_unloaded(config: Sections) -> Iterator[Problem]:
    asked = config.safety.engage_torque
    if _is_real(config) and asked is not None and asked > MOST_TORQUE:
        yield Problem(
            f"found {asked:g}",
            field="safety.engage_torque",
            wanted=f"at most {MOST_TORQUE:g} N·m: the servo at {config.servo.port} is real, "
            "and a wall that comes on with more torque strikes the hand that holds the shaft",
        )


@_rule
def _law_is_whole(config: Sections) -> Iterator[Problem]:
    wall, counts = config.wall, config.servo.counts_per_rev
    if wall.law == "wall" or any(map(own.is_closed, law_names(wall))):
        yield from _numbers_of_another_law(config)
        return
    # The encoder of a real servo is known only once it is open.
    step = math.tau / counts if counts and config.servo.kind != "hardware" else 0.0
    grid = Grid(config.period_s, step)
    parts = wall.parts if wall.law == SUM else (wall,)
    try:
        shape_of(wall, grid)
        lossy = [part.law for part in parts if not shape_of(part, grid).stores_work]
    except LawError as error:
        yield Problem(error.found, wanted=error.wanted, field=f"wall.{error.field}")
    else:
        yield from _numbers_of_another_law(config)
        if lossy and wall.passivity_control:
            yield Problem(
                "found true",
                field="wall.passivity_control",
                wanted=f"false with the law {lossy[0]}: its potential is not the energy that it"
                " took",
            )


def law_names(wall: Wall) -> list[str]:
    """Return the name of the law, or those of a sum's parts."""
    return [part.law for part in wall.parts] if wall.law == SUM else [wall.law]


def _numbers_of_another_law(config: Sections) -> Iterator[Problem]:
    """Report numbers that the law does not use, and the laws that use them."""
    wall = config.wall
    for name, others in _unused(wall, (*LawNumbers.model_fields, "parts")):
        yield Problem(
            f"found a value, which the law {wall.law} does not use",
            field=f"wall.{name}",
            advice=f"it is for wall.law {others}",
        )
    for place, part in enumerate(wall.parts if wall.law == SUM else ()):
        for name, others in _unused(part, tuple(LawNumbers.model_fields)):
            yield Problem(
                f"in part {place}, found {name}, which the law {part.law} does not use",
                field="wall.parts",
                advice=f"it is for the law {others}",
            )


def _unused(law: LawNumbers, names: Iterable[str]) -> Iterator[tuple[str, str]]:
    """Yield each number that is set but not used by the law, with the laws that use it."""
    uses = {name: kind.numbers for name, kind in LAWS.items()} | {SUM: ("parts",)}
    used = uses.get(law.law, ("options",))
    for name in names:
        if name in ("law", "side", *used) or getattr(law, name) == Wall.model_fields[name].default:
            continue
        others = [each for each, numbers in uses.items() if name in numbers] or ["module:Class"]
        yield name, " or ".join(others)


@_rule
def _travel_reaches_the_wall(config: Sections) -> Iterator[Problem]:
    if config.safety.travel is None:
        return
    low, high = config.safety.travel
    found = f"found [{low:g}, {high:g}]"
    if low >= high:
        yield Problem(found, wanted="[low, high] with low below high", field="safety.travel")
    elif not low <= config.wall.position <= high:
        yield Problem(
            found,
            wanted=f"a range that contains wall.position {config.wall.position:g}: otherwise the "
            "run ends before the shaft is at the wall",
            field="safety.travel",
        )


@_rule
def _emulated_counts(config: Sections) -> Iterator[Problem]:
    if config.servo.kind == "emulated" and config.servo.counts_per_rev != 4096:
        yield Problem(
            f"found {config.servo.counts_per_rev}",
            field="servo.counts_per_rev",
            wanted="4096, as the position register of the X series has it",
            advice="only servo.backend simulated can have another encoder",
        )


@_rule
def _truth_agrees(config: Sections) -> Iterator[Problem]:
    if config.servo.kind != "hardware":
        for problem in disagreements(config.servo):
            yield replace(problem, field=f"servo.{problem.field}")


_MOST_STEPS = {True: 2e4, False: 1e5}
"""Most steps of a motion with masses in a second, in real time and not: one takes 20 to 200 µs"""
_TRANSMISSION = ("load_inertia", "transmission_stiffness", "transmission_damping")


@_rule
def _transmission_is_computable(config: Sections) -> Iterator[Problem]:
    servo, real = config.servo, config.loop.clock == "monotonic"
    fastest = vibration(servo).rate
    if servo.kind == "hardware" or not servo.inertia or not fastest:
        return
    lighter = min(servo.inertia, servo.load_inertia)
    rates = {
        "transmission_stiffness": fastest,
        "transmission_damping": 2.0 * servo.transmission_damping / lighter,
        "damping": max(servo.damping, servo.damping_back or 0.0) / servo.inertia,
    }
    most, steps = _MOST_STEPS[real], sum(rates.values()) / 2.0
    if steps > most:
        field = max(rates, key=rates.__getitem__)
        clock = "in real time" if real else "on the simulated clock"
        yield Problem(
            f"found {getattr(servo, field):g}, with which the simulated motion takes {steps:.2g}"
            " steps a second",
            wanted=f"at most {most:g} {clock}",
            advice="a transmission this stiff or damped is rigid: leave it out, and add the load's"
            " inertia to servo.inertia",
            field=f"servo.{field}",
        )


@_rule
def _delay_is_computable(config: Sections) -> Iterator[Problem]:
    believed, servo, rate = config.model.delay, config.servo, config.loop.rate_hz
    lag = servo.delay + servo.current_lag if believed is None else believed.high
    if lag > MOST_LAG:
        yield Problem(
            f"found a lag of {lag:.3g} s, servo.current_bandwidth included",
            wanted=f"at most {MOST_LAG:g} s where model.delay is not given",
            field="servo.delay",
        )
    elif (periods := config.delay.steps + (config.guard.sample_age + lag) * rate) > _MOST_PERIODS:
        yield Problem(
            f"found {periods:.0f} periods of delay in all",
            wanted=f"at most {_MOST_PERIODS}",
            field="guard.sample_age",
        )


@_rule
def _vibration_as_a_whole(config: Sections) -> Iterator[Problem]:
    model, rigid = config.model, config.servo.load_inertia == 0.0
    load, frequency = (
        each is not None and each.high > 0.0 for each in (model.load_inertia, model.flexible_hz)
    )
    derived = model.transmission_stiffness is not None
    if frequency and model.flexible_hz is not None and model.flexible_hz.low == 0.0:
        yield Problem(
            "found 0 as its low bound",
            wanted="a low bound above 0, or 0 alone: rigid",
            field="model.flexible_hz",
        )
    if rigid and load != frequency and not (load and derived):
        missing = "flexible_hz" if load else "load_inertia"
        yield Problem(
            "found none",
            wanted="a value above 0: a load that vibrates on its transmission has"
            " model.load_inertia and model.flexible_hz or model.transmission_stiffness",
            field=f"model.{missing}",
        )


@_rule
def _load_within_the_inertia(config: Sections) -> Iterator[Problem]:
    model, servo = config.model, config.servo
    if model.load_inertia is None:
        return
    truth = (servo.inertia or 0.0) + servo.load_inertia
    whole = truth if model.inertia is None else model.inertia.value
    if 0.0 < whole <= model.load_inertia.value:
        yield Problem(
            f"found {model.load_inertia.value:g} kg·m²",
            wanted=f"less than model.inertia, {whole:g}, the inertia of everything that the servo"
            " turns, as identify measures it: the load is a part of it",
            field="model.load_inertia",
        )


@_rule
def _emulated_gain(config: Sections) -> Iterator[Problem]:
    if (
        config.servo.hides_constant
        and config.servo.torque_constant is not None
        and config.model.torque_gain is None
    ):
        yield Problem(
            "found nothing",
            field="model.torque_gain",
            wanted="a number or {value, low, high}: with servo.torque_constant "
            f"{config.servo.torque_constant:g} the emulated servo differs from its model's data "
            "sheet, which the driver uses",
        )


@_rule
def _model_makes_torque(config: Sections) -> Iterator[Problem]:
    name, known = config.servo.model, backend(config.servo.backend).models
    if known is None or name is None:
        return
    models = known()
    if name not in models:
        yield Problem(
            f"found {name!r}",
            field="servo.model",
            wanted=f"one of the models with current control: {', '.join(models)}",
            advice=did_you_mean(name.upper(), models),
        )
    elif not models[name].constant_known and config.servo.torque_constant is None:
        yield Problem(
            "found nothing",
            field="servo.torque_constant",
            wanted=f"a measured torque per current [N·m/A]: the {name} has no published one",
        )


@_rule
def _faults_can_happen(config: Sections) -> Iterator[Problem]:
    servo = config.servo
    if servo.faults and servo.kind == "simulated":
        yield Problem(
            f"found {', '.join(servo.faults)}, but a simulated servo has no bus",
            field="servo.faults",
            advice="use an emulated one, such as the preset emulated-xm430",
        )


@_rule
def _backend_finds_no_problem(config: Sections) -> Iterator[Problem]:
    find = backend(config.servo.backend).problems
    if find is not None:
        with suppress(ValidationError):  # of the options, which another rule names
            yield from find(config.servo.asked())


_CYCLE_SHARE = 0.8
"""Largest fraction of a period for a cycle on the wire: later replies count as lost"""


@_rule
def _cycle_fits_the_period(config: Sections) -> Iterator[Problem]:
    baud, cycle_s = config.servo.baud, backend(config.servo.backend).cycle_s
    if cycle_s is None or baud is None:
        return
    cycle = cycle_s(baud)
    if cycle > _CYCLE_SHARE * config.period_s:
        yield Problem(
            f"found {baud}, at which a cycle takes {1e3 * cycle:.3g} ms on the wire, "
            f"more than {_CYCLE_SHARE:g} of a period of {1e3 * config.period_s:.3g} "
            "ms",
            field="servo.baud",
            advice="use a faster bus (set the servo's rate first) or loop.rate_hz below "
            f"{_CYCLE_SHARE / cycle:.3g}",
        )


@_rule
def _watchdog_is_patient(config: Sections) -> Iterator[Problem]:
    watchdog, period = config.servo.watchdog_s, config.period_s
    if backend(config.servo.backend).has_watchdog and watchdog < 2 * period:
        yield Problem(
            f"found {watchdog:g} s",
            field="servo.watchdog_s",
            wanted=f"at least two periods ({2 * period:g} s at loop.rate_hz "
            f"{config.loop.rate_hz:g}), else one lost message stops the servo",
        )


@_rule
def _silence_ends_before_the_watchdog(config: Sections) -> Iterator[Problem]:
    silence, most = config.safety.max_silence_s, SILENCE_SHARE * config.servo.watchdog_s
    if backend(config.servo.backend).has_watchdog and silence > most * (1 + 1e-9):
        yield Problem(
            f"found {silence:g} s",
            field="safety.max_silence_s",
            wanted=f"at most {most:g} s, half of servo.watchdog_s "
            f"({config.servo.watchdog_s:g} s): the run must end before the Bus "
            "Watchdog of a silent servo can have dropped the torque",
        )


@_rule
def _warm_up_sees_the_bus(config: Sections) -> Iterator[Problem]:
    least = WARM_UP_AGES * config.period_s
    if backend(config.servo.backend).has_bus and config.loop.warm_up_s < least * (1 - 1e-9):
        yield Problem(
            f"found {config.loop.warm_up_s:g} s",
            field="loop.warm_up_s",
            wanted=f"at least {least:g} s ({WARM_UP_AGES} readings at loop.rate_hz "
            f"{config.loop.rate_hz:g}): the delay of the bus is measured before the "
            "wall is switched on",
        )


@_rule
def _heartbeat_is_patient(config: Sections) -> Iterator[Problem]:
    heartbeat, period = config.safety.heartbeat_s, config.period_s
    if heartbeat < 2 * period:
        yield Problem(
            f"found {heartbeat:g} s",
            field="safety.heartbeat_s",
            wanted=f"at least two periods ({2 * period:g} s at loop.rate_hz "
            f"{config.loop.rate_hz:g}), else every tick looks like a hang",
        )


SILENCE_SHARE = 0.5
"""Fraction of the Bus Watchdog's time after which a run without good readings ends"""
WARM_UP_AGES = 20
"""Number of readings over a bus that determine its delay well enough"""


@_rule
def _spinning_leaves_time_to_sleep(config: Sections) -> Iterator[Problem]:
    spin_us, most_us = config.realtime.spin_us, SPIN_SHARE * config.period_s * 1e6
    if spin_us is not None and spin_us > most_us * (1 + 1e-9):
        yield Problem(
            f"found {spin_us:g} µs",
            field="realtime.spin_us",
            wanted=f"at most {SPIN_SHARE:g} of a period ({most_us:g} µs at loop.rate_hz "
            f"{config.loop.rate_hz:g}): Linux halts a real-time process that never "
            "sleeps for 50 ms of every second",
        )


_FILTER = ("wall.velocity_filter", "wall.velocity_hz", "wall.velocity_q", "loop.rate_hz")


@_rule
def _filter_is_below_half_the_rate(config: Sections) -> Iterator[Problem]:
    wall, rate = config.wall, config.loop.rate_hz
    if wall.velocity_filter == "none":
        return
    if not wall.velocity_hz < MOST_OF_RATE * rate:
        yield Problem(
            f"found {wall.velocity_hz:g} Hz",
            wanted=f"less than {MOST_OF_RATE * rate:g} Hz, which is {MOST_OF_RATE:g} of"
            " loop.rate_hz",
            field="wall.velocity_hz",
        )
    if wall.velocity_filter == "lowpass" and wall.velocity_q > MOST_LOWPASS_Q:
        yield Problem(
            f"found {wall.velocity_q:g}",
            wanted=f"at most {MOST_LOWPASS_Q:g} for a low-pass: above it amplifies at its corner",
            field="wall.velocity_q",
        )


@_rule
def _filter_is_counted(config: Sections) -> Iterator[Problem]:
    wall = config.wall
    if wall.velocity_filter == "none":
        return
    lacking = {
        "wall.law wall": wall.law != "wall",
        "wall.side both: a one-sided wall's limit is not known with a filter": wall.side != "both",
        "wall.passivity_control false": wall.passivity_control,
        "guard.mode stable or off: passivity is not known with a filter": (
            config.guard.mode == "passive"
        ),
        "model.backlash 0: its limit is not known with a filter": (
            config.model.backlash is not None and config.model.backlash.high > 0.0
        ),
        f"model.flexible_hz known to {WIDEST_NOTCHED_HZ:g} Hz for a notch": (
            wall.velocity_filter == "notch" and _is_widely_flexible(config)
        ),
    }
    for wanted, broken in lacking.items():
        if broken:
            yield Problem(
                f"found {wall.velocity_filter}", wanted=f"none, or {wanted}", field=_FILTER[0]
            )
            return


def _is_widely_flexible(config: Sections) -> bool:
    """Whether the belief has a load whose frequency is known only within a wide range."""
    model = config.model
    if model.load_inertia is None or model.load_inertia.high == 0.0:
        return False
    hz = model.flexible_hz
    return hz is None or hz.high - hz.low > WIDEST_NOTCHED_HZ
