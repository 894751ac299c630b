"""Compares the rendered wall with the commanded one: stiffness, drag, and contacts.

The servo is identified, a spring is pushed, the wall is hit. The program knows commanded torques
only; the fraction of a torque that acts shows only with a known inertia. The believed inertia is
therefore the reference for results in true units.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from haptic_wall.controller.experiments.delay import measure
from haptic_wall.controller.experiments.holding import hold_of, torque_limit_of, without_hand
from haptic_wall.controller.experiments.identify.identification import (
    REACH as IDENTIFIED_REACH,
)
from haptic_wall.controller.experiments.identify.identification import begun, bounds_of
from haptic_wall.controller.experiments.rendered.contact_transient import (
    FASTEST,
    REACH,
    Contact,
    approach_phases,
    contacts,
    plan_approach,
)
from haptic_wall.controller.experiments.rendered.rows import (
    Comparison,
    contact_rows,
    free_rows,
    stiffness_rows,
)
from haptic_wall.controller.experiments.rendered.static_stiffness import (
    StaticStiffness,
    plan_push,
    push_phases,
    static_stiffness,
)
from haptic_wall.controller.experiments.testbed import Testbed
from haptic_wall.controller.guard.guard import Situation, decide
from haptic_wall.controller.guard.types import Decision, Request
from haptic_wall.controller.settings.config import Config
from haptic_wall.controller.theory.one_sided import restitution

SECONDS = 110
"""Approximate duration of all measurements [s]"""


@dataclass(frozen=True, slots=True)
class Rendering:
    """All results."""

    stiffness: float
    """Commanded [N·m/rad]"""
    damping: float
    """Commanded [N·m·s/rad]"""
    requested: Request
    binding: str | None
    """Name of the limit that bound the stiffness; None: no limit did"""
    rows: tuple[Comparison, ...]
    static: StaticStiffness | None
    contacts: tuple[Contact, ...]
    predicted: tuple[Contact, ...]
    """The same contacts of a simulated servo with the believed values"""
    notes: tuple[str, ...]


def announcement(config: Config) -> str:
    """Announce the motions and their size, for a person."""
    reach = max(REACH, IDENTIFIED_REACH)
    speed = max(FASTEST, bounds_of(config, IDENTIFIED_REACH).speed)
    return (
        f"the shaft will move within ±{reach:g} rad of its position, at up to {speed:.2g} rad/s,"
        f" and strike the wall; this takes about {SECONDS} s"
        + ("; keep clear of it" if config.servo.kind == "hardware" else "")
    )


def measure_rendering(
    config: Config,
    folder: Path,
    seed: int = 0,
    tell: Callable[[str], None] = lambda _text: None,
) -> Rendering:
    """Measure the wall that the servo of a configuration renders.

    Args:
        config: The servo, and the requested wall; the guard decides the commanded one, as in a run.
            A scripted operator is switched off.
        folder: Folder for the logs.
        seed: Seed of all random choices.
        tell: Called with messages for a person.

    Raises:
        UserError: The torque limit is unknown.
        UnidentifiableError: The servo did not respond, or not as a rigid one.
        ExperimentInterruptedError: A person has ended it.
        ExperimentTrippedError: A trip has ended it.
        ServoError: The servo could not be started.
    """
    config = without_hand(config)
    limit, steps = torque_limit_of(config), config.delay.steps
    hold = hold_of(config, limit, steps)
    tell(announcement(config))
    tell("1 of 3: motions of the free shaft, for torque gain, friction, delay and backlash")
    bounds = bounds_of(config, IDENTIFIED_REACH)
    bench, rough = begun(config, folder, bounds, tell)
    moved = measure(bench, "rendered-motions", rough, bounds, steps)
    fit, lag = moved.fit, moved.total.value
    age = float(np.percentile(moved.ages, config.guard.delay_percentile))
    bed = Testbed(config, folder, tell)
    wall = _decision(config, config.wall.side, limit, age)
    belief = config.belief()
    friction = max(belief.coulomb.value / belief.torque_gain.value, fit.coulomb)
    direction = -1.0 if config.wall.side == "below" else 1.0

    static = None
    push = plan_push(wall.stiffness, wall.damping, friction, limit, bounds.step)
    if push is not None:
        tell("2 of 3: a slow push on the spring, to both sides")
        phases = push_phases(push, hold, direction)
        rows = bed.play("rendered-static", phases).rows
        static = static_stiffness(rows, phases, push, bounds.step)

    one_sided = wall
    if config.wall.side == "both":
        one_sided = _decision(config, "above", limit, age)
    approach = plan_approach(
        one_sided.stiffness,
        one_sided.damping,
        fit.inertia,
        limit,
        config.planned_speed,
        lag,
    )
    struck: list[Contact] = []
    worst = math.nan
    predicted: list[Contact] = []
    if approach is not None:
        tell("3 of 3: contacts with the wall, measured and simulated")
        phases = approach_phases(approach, hold, fit, direction, lag, seed)
        played = bed.play("rendered-contacts", phases)
        struck = contacts(played.rows, phases, fit, direction, lag)
        worst = float(
            restitution(
                fit.inertia,
                max(fit.damping, 0.0),
                approach.stiffness,
                approach.damping,
                config.period_s,
                max(lag, 0.0),
                velocity_samples=config.wall.velocity_samples,
            )
        )
        twin = Testbed(_believed(config, float(np.median(moved.ages))), folder)
        played = twin.play("rendered-contacts-predicted", phases)
        predicted = contacts(played.rows, phases, fit, direction, lag)
    compared = (
        *stiffness_rows(config, wall.stiffness, push, static, fit),
        *free_rows(config, moved),
        *contact_rows(approach, struck, predicted, worst),
    )
    return Rendering(
        wall.stiffness,
        wall.damping,
        config.request(),
        wall.binding,
        compared,
        static,
        tuple(struck),
        tuple(predicted),
        tuple(filter(None, [moved.note])),
    )


def rendering_report(found: Rendering) -> dict[str, Any]:
    """Return the result as JSON-ready values."""
    return {
        "requested": {"stiffness": found.requested.stiffness, "damping": found.requested.damping},
        "commanded": {"stiffness": found.stiffness, "damping": found.damping},
        "binding": found.binding,
        "rows": [row.report() for row in found.rows],
        "contacts": [_contact_report(contact) for contact in found.contacts],
        "predicted_contacts": [_contact_report(contact) for contact in found.predicted],
        "notes": list(found.notes),
    }


def _contact_report(contact: Contact) -> dict[str, float]:
    return {
        "entry_speed": contact.entry,
        "exit_speed": contact.exit,
        "penetration": contact.penetration,
        "torque": contact.torque,
        "seconds": contact.seconds,
    }


def _decision(config: Config, side: Any, limit: float, age: float) -> Decision:  # noqa: ANN401
    """Decide on the wall that a run would command at the measured age."""
    request, period = config.request(), config.period_s
    step = config.servo.position_step
    situation = Situation(config.belief(), period, limit, step)
    inserted = config.delay.steps * period
    age = max(age, config.guard.sample_age)
    wanted = Request(request.stiffness, request.damping, side, request.velocity_samples)
    return decide(wanted, config.guard_settings(), situation, [inserted + age], inserted)[0]


def _believed(config: Config, age: float) -> Config:
    """Return a simulated servo with the believed values, on the simulated clock."""
    belief = config.belief()
    raw = config.model_dump(mode="json")
    gain = belief.torque_gain.value
    raw["servo"] = {
        "backend": "simulated",
        # A torque gain above 1 moves a servo as if it were lighter.
        "inertia": belief.inertia.value / gain,
        "damping": belief.damping.value / gain,
        "coulomb": belief.coulomb.value / gain,
        "counts_per_rev": config.servo.counts_per_rev,
        "delay": belief.delay.value + age,
        "torque_limit": torque_limit_of(config),
    }
    raw["model"] = {}
    raw["loop"]["clock"] = "simulated"
    raw["realtime"] = {"profile": "off"}
    return Config.model_validate(raw)
