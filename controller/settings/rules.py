"""Checks the rules between fields; each rule names the field at fault."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace

from haptic_wall.controller.guard.belief import HEAVIEST
from haptic_wall.controller.laws import own
from haptic_wall.controller.laws.engagement import MOST_TORQUE
from haptic_wall.controller.laws.shape import Grid, LawError
from haptic_wall.controller.laws.table import SUM, shape_of
from haptic_wall.controller.laws.wall import NONE
from haptic_wall.controller.settings.axes import OWN
from haptic_wall.controller.settings.axes_rules import apart, broken_bus_rules
from haptic_wall.controller.settings.model import MOST_LAG, Wall
from haptic_wall.controller.settings.sections import Sections
from haptic_wall.controller.settings.servo import TRUTH_FIELDS
from haptic_wall.hw.errors import Problem
from haptic_wall.hw.open import other_model, torque_models
from haptic_wall.hw.truth import disagreements


class BrokenRulesError(ValueError):
    """Raised if fields are valid by themselves, but not together."""

    def __init__(self, problems: list[Problem]) -> None:
        super().__init__("; ".join(map(str, problems)))
        self.problems = problems


MOST_OF_RATE = 0.45
"""Highest frequency of a filter of the velocity, as a fraction of the rate"""
MOST_LOWPASS_Q = 0.7072
"""Quality of a low-pass of the velocity above which its gain exceeds 1. From about 2 on a *shorter*
delay can be the less safe one, which the guard does not count"""
WIDEST_NOTCHED_HZ = 60.0
"""Widest range of a vibration's believed frequency with a notch [Hz]; the start already takes
seconds"""
SILENCE_SHARE = 0.5
"""Fraction of the Bus Watchdog's time after which a run without good readings ends"""
WARM_UP_AGES = 20
"""Number of readings over a bus that determine its delay well enough"""
_REQUIRED = {
    "port": "a serial device such as /dev/ttyUSB0, or emulated",
    "baud": "the speed the servo is set to, e.g. 4000000",
    "model": "the servo's model, e.g. XM430-W350",
}
"""Fields of a servo on a bus, and their meaning"""
_BELIEVED = ("inertia", "damping", "coulomb", "delay", "torque_gain")
_ROUNDED = 1 + 1e-9


def broken_rules(config: Sections) -> list[Problem]:
    """Return the violations of all rules between fields, each of which is valid by itself."""
    if found := list(apart(config)):
        return found
    rules = (_real, _simulated, _on_a_bus, _times, _delay, _law, _travel, _load, _filter)
    found = [
        _of_axis(name, problem)
        for name, one in config.each.items()
        for rule in rules
        for problem in rule(one)
    ]
    return list(dict.fromkeys([*found, *broken_bus_rules(config)]))


def _of_axis(name: str, problem: Problem) -> Problem:
    """Return the problem with the path in the whole configuration."""
    own = name and (problem.field or "").split(".")[0] in OWN
    return replace(problem, field=f"axes.{name}.{problem.field}") if own else problem


def _real(config: Sections) -> Iterator[Problem]:
    """Rules of a real servo; another rule reports a missing port."""
    servo, asked = config.servo, config.safety.engage_torque
    if servo.kind != "hardware" or servo.port is None:
        return
    real = f"the servo at {servo.port} is real"
    for name in TRUTH_FIELDS:
        if name in servo.model_fields_set:
            belief = f"set the belief model.{name} instead" if name in _BELIEVED else "leave it out"
            yield Problem(
                f"found {getattr(servo, name)!r}, but only simulated and emulated servos have this "
                f"setting, and servo.port {servo.port} is a real one",
                advice=belief,
                field=f"servo.{name}",
            )
    for name in _BELIEVED:
        if getattr(config.model, name) is None:
            wanted = "a number or {value, low, high}: the controller knows a real servo only from"
            yield Problem(
                "found nothing", field=f"model.{name}", wanted=f"{wanted} the configuration"
            )
    if config.loop.clock == "simulated":
        yield Problem("found simulated", field="loop.clock", wanted=f"monotonic: {real}")
    strikes = "strikes the hand that holds"
    if config.safety.engage == "at-once":
        wanted = f"wait: {real}, and a wall that comes on around its shaft {strikes} it"
        yield Problem("found at-once", field="safety.engage", wanted=wanted)
    if asked is not None and asked > MOST_TORQUE:
        yield Problem(
            f"found {asked:g}",
            field="safety.engage_torque",
            wanted=f"at most {MOST_TORQUE:g} N·m: {real}, and a wall that comes on with more torque"
            f" {strikes} the shaft",
        )


def _simulated(config: Sections) -> Iterator[Problem]:
    """Rules of the truth of a simulated or emulated servo."""
    servo = config.servo
    if servo.kind == "hardware":
        return
    if servo.inertia is None:
        wanted = f"the inertia of the {servo.kind} servo [kg·m²] above 0"
        yield Problem("found nothing", field="servo.inertia", wanted=wanted)
    for problem in disagreements(servo):
        yield replace(problem, field=f"servo.{problem.field}")
    if servo.kind == "emulated" and servo.counts_per_rev != 4096:
        yield Problem(
            f"found {servo.counts_per_rev}",
            field="servo.counts_per_rev",
            wanted="4096, as the position register of the X series has it",
            advice="only servo.backend simulated can have another encoder",
        )
    if servo.faults and servo.kind == "simulated":
        yield Problem(
            f"found {', '.join(servo.faults)}, but a simulated servo has no bus",
            field="servo.faults",
            advice="use an emulated one, such as the preset emulated-xm430",
        )
    if servo.hides_constant and servo.torque_constant and config.model.torque_gain is None:
        yield Problem(
            "found nothing",
            field="model.torque_gain",
            wanted=f"a number or {{value, low, high}}: with servo.torque_constant "
            f"{servo.torque_constant:g} the emulated servo differs from its model's data sheet, "
            "which the driver uses",
        )


def _on_a_bus(config: Sections) -> Iterator[Problem]:
    """Rules of a servo on a bus."""
    servo = config.servo
    if servo.kind == "simulated":
        return
    for field, what in _REQUIRED.items():
        if getattr(servo, field) is None:
            wanted = f"{what} (servo.backend is {servo.backend})"
            yield Problem("found nothing", field=f"servo.{field}", wanted=wanted)
    if servo.model is None:
        return
    models = torque_models()
    if servo.model not in models:
        yield Problem(
            f"found {servo.model!r}",
            field="servo.model",
            wanted=f"one of the models with current control: {', '.join(models)}",
            advice=other_model(servo.model),
        )
    elif models[servo.model].torque_constant is None and servo.torque_constant is None:
        wanted = f"a measured torque per current [N·m/A]: the {servo.model} has no published one"
        yield Problem("found nothing", field="servo.torque_constant", wanted=wanted)


def _times(config: Sections) -> Iterator[Problem]:
    """Rules of times that must fit the period."""
    servo, safety, period = config.servo, config.safety, config.period_s
    on_bus, at = servo.kind != "simulated", f"at loop.rate_hz {config.loop.rate_hz:g}"
    two = f"at least two periods ({2 * period:g} s {at}), else"
    if on_bus and servo.watchdog_s < 2 * period:
        wanted = f"{two} one lost message stops the servo"
        yield Problem(f"found {servo.watchdog_s:g} s", field="servo.watchdog_s", wanted=wanted)
    most = SILENCE_SHARE * servo.watchdog_s
    if on_bus and safety.max_silence_s > most * _ROUNDED:
        yield Problem(
            f"found {safety.max_silence_s:g} s",
            field="safety.max_silence_s",
            wanted=f"at most {most:g} s, half of servo.watchdog_s ({servo.watchdog_s:g} s): the run"
            " must end before the Bus Watchdog of a silent servo can have dropped the torque",
        )
    least = WARM_UP_AGES * period
    if on_bus and config.loop.warm_up_s * _ROUNDED < least:
        yield Problem(
            f"found {config.loop.warm_up_s:g} s",
            field="loop.warm_up_s",
            wanted=f"at least {least:g} s ({WARM_UP_AGES} readings {at}): the delay of the bus is"
            " measured before the wall is switched on",
        )
    if safety.heartbeat_s < 2 * period:
        wanted = f"{two} every tick looks like a hang"
        yield Problem(f"found {safety.heartbeat_s:g} s", field="safety.heartbeat_s", wanted=wanted)


def _delay(config: Sections) -> Iterator[Problem]:
    lag = config.believed_delay().high
    if lag > MOST_LAG:
        yield Problem(
            f"found a lag of {lag:.3g} s, the current loop's included",
            wanted=f"at most {MOST_LAG:g} s",
            field="servo.delay" if config.model.delay is None else "model.delay",
        )


def _law(config: Sections) -> Iterator[Problem]:
    wall, counts = config.wall, config.servo.counts_per_rev
    if wall.law == NONE:  # a joint that rests for a while keeps its numbers
        return
    if wall.law == "wall" or any(map(own.is_closed, law_names(wall))):
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


def _travel(config: Sections) -> Iterator[Problem]:
    if config.safety.travel is None:
        return
    low, high = config.safety.travel
    found, field = f"found [{low:g}, {high:g}]", "safety.travel"
    if low >= high:
        yield Problem(found, wanted="[low, high] with low below high", field=field)
    elif not low <= config.wall.position <= high:
        yield Problem(
            found,
            wanted=f"a range that contains wall.position {config.wall.position:g}: otherwise the "
            "run ends before the shaft is at the wall",
            field=field,
        )


def _load(config: Sections) -> Iterator[Problem]:
    """Rules of the belief about a load on a flexible transmission."""
    model, servo = config.model, config.servo
    load, frequency = (
        each is not None and each.high > 0.0 for each in (model.load_inertia, model.flexible_hz)
    )
    if frequency and model.flexible_hz is not None and model.flexible_hz.low == 0.0:
        wanted = "a low bound above 0, or 0 alone: rigid"
        yield Problem("found 0 as its low bound", wanted=wanted, field="model.flexible_hz")
    derived = load and model.transmission_stiffness is not None
    if servo.load_inertia == 0.0 and load != frequency and not derived:
        yield Problem(
            "found none",
            wanted="a value above 0: a load that vibrates on its transmission has"
            " model.load_inertia and model.flexible_hz or model.transmission_stiffness",
            field=f"model.{'flexible_hz' if load else 'load_inertia'}",
        )
    truth = (servo.inertia or 0.0) + servo.load_inertia
    whole = truth if model.inertia is None else model.inertia.value
    given = model.load_inertia
    part = servo.load_inertia if given is None else given.value
    if not model.bare and 0.0 < HEAVIEST * whole < part:
        yield Problem(
            f"found {part:g} kg·m²",
            wanted=f"at most {HEAVIEST:g} times model.inertia, {whole:g}, the inertia of everything"
            " that the servo turns, as identify measures it: the load is a part of it",
            field=f"{'servo' if given is None else 'model'}.load_inertia",
        )


def _filter(config: Sections) -> Iterator[Problem]:
    """Rules of the filter of the velocity."""
    wall, rate, model = config.wall, config.loop.rate_hz, config.model
    if wall.velocity_filter == "none":
        return
    if not wall.velocity_hz < MOST_OF_RATE * rate:
        most = f"less than {MOST_OF_RATE * rate:g} Hz, which is {MOST_OF_RATE:g} of loop.rate_hz"
        yield Problem(f"found {wall.velocity_hz:g} Hz", wanted=most, field="wall.velocity_hz")
    if wall.velocity_filter == "lowpass" and wall.velocity_q > MOST_LOWPASS_Q:
        wanted = f"at most {MOST_LOWPASS_Q:g} for a low-pass: above it amplifies at its corner"
        yield Problem(f"found {wall.velocity_q:g}", wanted=wanted, field="wall.velocity_q")
    hz = model.flexible_hz
    wide = hz is None or hz.high - hz.low > WIDEST_NOTCHED_HZ
    load = model.load_inertia
    linked = config.servo.load_inertia > 0.0 if load is None else load.high > 0.0
    notch = wall.velocity_filter == "notch"
    lacking = {
        "wall.law wall": wall.law != "wall",
        "wall.side both: a one-sided wall's limit is not known with a filter": wall.side != "both",
        "wall.passivity_control false": wall.passivity_control,
        "guard.mode stable or off: passivity is not known with a filter": (
            config.guard.mode == "passive"
        ),
        "model.backlash 0: its limit is not known with a filter": (
            model.backlash is not None and model.backlash.high > 0.0
        ),
        f"model.flexible_hz known to {WIDEST_NOTCHED_HZ:g} Hz for a notch": (
            notch and load is not None and linked and wide
        ),
        "servo.encoder output for a notch: on the motor's side a damper needs none against a link, "
        "and its limits are not known with one": (
            notch and linked and config.servo.encoder == "motor"
        ),
    }
    for wanted in [each for each, broken in lacking.items() if broken][:1]:
        found = f"found {wall.velocity_filter}"
        yield Problem(found, wanted=f"none, or {wanted}", field="wall.velocity_filter")
