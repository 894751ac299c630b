"""Compares the rendered wall with the commanded one: stiffness, drag, and contacts.

A spring is pushed, the free shaft is moved, the wall is hit. The program knows commanded torques
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

from haptic_wall.controller.experiments.holding import torque_limit_of, without_hand
from haptic_wall.controller.experiments.rendered.contact_transient import (
    FASTEST,
    REACH,
    Contact,
    approach_phases,
    contacts,
    plan_approach,
)
from haptic_wall.controller.experiments.rendered.drag import Drag, drag, drag_phases
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
from haptic_wall.controller.experiments.steps.shaken import plan_shaking, shake
from haptic_wall.controller.experiments.steps.step_fit import from_command
from haptic_wall.controller.experiments.testbed import Testbed
from haptic_wall.controller.guard.guard import Situation, decide
from haptic_wall.controller.guard.types import Decision, Request
from haptic_wall.controller.settings.config import Config
from haptic_wall.controller.theory.one_sided import restitution

BURSTS = 8
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
    drag: Drag | None
    contacts: tuple[Contact, ...]
    predicted: tuple[Contact, ...]
    """The same contacts of a simulated servo with the believed values"""
    notes: tuple[str, ...]


def announcement(config: Config, speed: float) -> str:
    """Announce the motions and their size, for a person.

    Args:
        config: The servo.
        speed: Speed of the fastest part [rad/s].
    """
    return (
        f"the shaft will move within ±{REACH:g} rad of its position, at up to {speed:.2g} rad/s,"
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
        UserError: The torque limit is unknown, or too small against friction.
        ExperimentFailedError: The servo did not respond, or not as expected.
        ExperimentInterruptedError: A person has ended it.
        ExperimentTrippedError: A trip has ended it.
        ServoError: The servo could not be started.
    """
    config = without_hand(config)
    limit, steps = torque_limit_of(config), config.delay.steps
    shaking = plan_shaking(config, limit, steps, BURSTS, seed)
    tell(announcement(config, max(shaking.plan.speed, FASTEST)))
    bed = Testbed(config, folder, tell)
    tell("1 of 4: torque steps, for torque gain, delay and lost motion")
    shaken = shake(bed, "rendered-steps", shaking)
    fit = shaken.fit
    lag = from_command(fit, config.period_s).lag
    age = float(np.percentile(shaken.ages, config.guard.delay_percentile))
    wall = _decision(config, config.wall.side, limit, age)
    belief = config.belief()
    friction = max(belief.coulomb.value / belief.torque_gain.value, fit.friction / fit.acceleration)
    step = shaking.hold.position_step
    direction = -1.0 if config.wall.side == "below" else 1.0

    static = None
    push = plan_push(wall.stiffness, wall.damping, friction, limit, step)
    if push is not None:
        tell("2 of 4: a slow push on the spring, to both sides")
        phases = push_phases(push, shaking.hold, direction)
        static = static_stiffness(bed.play("rendered-static", phases).rows, phases, push, step)
    tell("3 of 4: motion of the free shaft at several speeds")
    phases = drag_phases(shaking.hold, config.planned_speed)
    moved = drag(bed.play("rendered-drag", phases).rows, phases, fit)

    one_sided = wall
    if config.wall.side == "both":
        one_sided = _decision(config, "above", limit, age)
    approach = plan_approach(
        one_sided.stiffness,
        one_sided.damping,
        1.0 / fit.acceleration,
        limit,
        config.planned_speed,
        lag,
    )
    struck: list[Contact] = []
    worst = math.nan
    predicted: list[Contact] = []
    if approach is not None:
        tell("4 of 4: contacts with the wall, measured and simulated")
        phases = approach_phases(approach, shaking.hold, fit, direction, lag, seed)
        played = bed.play("rendered-contacts", phases)
        struck = contacts(played.rows, phases, fit, direction, lag)
        worst = float(
            restitution(
                1.0 / fit.acceleration,
                max(fit.decay / fit.acceleration, 0.0),
                approach.stiffness,
                approach.damping,
                config.period_s,
                max(lag, 0.0),
                velocity_samples=config.wall.velocity_samples,
            )
        )
        twin = Testbed(_believed(config, float(np.median(shaken.ages))), folder)
        played = twin.play("rendered-contacts-predicted", phases)
        predicted = contacts(played.rows, phases, fit, direction, lag)
    rows = (
        *stiffness_rows(config, wall.stiffness, push, static, shaken),
        *free_rows(config, shaken, moved),
        *contact_rows(approach, struck, predicted, worst),
    )
    return Rendering(
        wall.stiffness,
        wall.damping,
        config.request(),
        wall.binding,
        rows,
        static,
        moved,
        tuple(struck),
        tuple(predicted),
        tuple(filter(None, [shaken.note])),
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
