"""What is rendered against what is commanded: stiffness, drag, and contacts with the wall.

A spring is pushed, the free shaft is moved, the wall is struck. All torques that the program knows
are commanded ones: how much of a commanded torque acts shows only against an inertia that is known,
so the believed one is the yardstick of what is said in true units.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from controller.config import Config
from controller.experiments.contact_transient import (
    FASTEST,
    REACH,
    Approach,
    Contact,
    approach_phases,
    contacts,
    plan_approach,
)
from controller.experiments.drag import Drag, drag, drag_phases
from controller.experiments.holding import torque_limit_of, without_hand
from controller.experiments.shaken import Shaken, plan_shaking, shake
from controller.experiments.static_stiffness import (
    Push,
    StaticStiffness,
    plan_push,
    push_phases,
    static_stiffness,
)
from controller.experiments.step_fit import from_command, lost_motion
from controller.experiments.testbed import Testbed
from controller.guard import Situation, decide
from controller.guard_types import Decision, Request
from controller.theory.one_sided import restitution

BURSTS = 8
_NOT_MOVED = "the shaft did not follow at two speeds both ways"
SECONDS = 110
"""About what all of it takes [s]"""


@dataclass(frozen=True, slots=True)
class Row:
    """One line of the comparison."""

    name: str
    unit: str
    commanded: float | None
    """Or expected, where nothing is commanded; None: neither is known"""
    rendered: float | None
    """None: it could not be measured, the note says why"""
    stderr: float | None
    note: str = ""

    @property
    def ratio(self) -> float | None:
        """Rendered over commanded; None where there is none."""
        if self.rendered is None or not self.commanded:
            return None
        return self.rendered / self.commanded

    def report(self) -> dict[str, Any]:
        """For JSON."""
        return {**asdict(self), "ratio": self.ratio}


@dataclass(frozen=True, slots=True)
class Rendering:
    """All that was measured."""

    stiffness: float
    """Commanded [N·m/rad]"""
    damping: float
    """Commanded [N·m·s/rad]"""
    requested: Request
    binding: str | None
    """The limit of the guard that bound the stiffness; None: none did"""
    rows: tuple[Row, ...]
    static: StaticStiffness | None
    drag: Drag | None
    contacts: tuple[Contact, ...]
    predicted: tuple[Contact, ...]
    """The same contacts of a simulated servo that is what is believed of this one"""
    notes: tuple[str, ...]


def announcement(config: Config, speed: float) -> str:
    """What will move, and how far, for a person.

    Args:
        config: The servo.
        speed: Of the fastest part [rad/s].
    """
    return (
        f"the shaft will be moved within ±{REACH:g} rad of where it is, at up to {speed:.2g} rad/s,"
        f" and struck against the wall; it takes about {SECONDS} s"
        + ("; keep clear of it" if config.servo.kind == "hardware" else "")
    )


def measure_rendering(
    config: Config,
    folder: Path,
    seed: int = 0,
    tell: Callable[[str], None] = lambda _text: None,
) -> Rendering:
    """Measure what the servo of a configuration renders.

    Args:
        config: The servo, and the wall that is asked for; the guard decides what is commanded, as
            in a run. A scripted hand is kept off.
        folder: Where the logs go.
        seed: Of all that is random.
        tell: Called with what a person should know meanwhile.

    Raises:
        UserError: The torque limit is unknown, or too small against friction.
        ExperimentFailedError: The servo did not move, or not as asked.
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
        tell("2 of 4: the spring is pushed to and fro")
        phases = push_phases(push, shaking.hold, direction)
        static = static_stiffness(bed.play("rendered-static", phases).rows, phases, push, step)
    tell("3 of 4: the free shaft is moved at several speeds")
    phases = drag_phases(shaking.hold, config.safety.max_speed)
    moved = drag(bed.play("rendered-drag", phases).rows, phases, fit)

    one_sided = wall
    if config.wall.side == "both":
        one_sided = _decision(config, "above", limit, age)
    approach = plan_approach(
        one_sided.stiffness,
        one_sided.damping,
        1.0 / fit.acceleration,
        limit,
        config.safety.max_speed,
        lag,
    )
    struck: list[Contact] = []
    worst = math.nan
    predicted: list[Contact] = []
    if approach is not None:
        tell("4 of 4: contacts with the wall, and the same simulated")
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
        *_stiffness_rows(config, wall, push, static, shaken),
        *_free_rows(config, shaken, moved),
        *_contact_rows(approach, struck, predicted, worst),
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
    """As JSON-ready values."""
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
    """What a run would command at the measured age."""
    request, period = config.request(), config.period_s
    step = math.tau / config.servo.counts_per_rev if config.servo.counts_per_rev else 0.0
    situation = Situation(config.belief(), period, limit, step)
    inserted = config.delay.steps * period
    age = max(age, config.guard.sample_age)
    wanted = Request(request.stiffness, request.damping, side, request.velocity_samples)
    return decide(wanted, config.guard_settings(), situation, [inserted + age], inserted)[0]


def _believed(config: Config, age: float) -> Config:
    """A simulated servo that is what is believed of the real one, on the simulated clock."""
    belief = config.belief()
    raw = config.model_dump(mode="json")
    gain = belief.torque_gain.value
    raw["servo"] = {
        "backend": "simulated",
        # A torque that acts by a share of itself moves a servo as if that were lighter.
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


def _stiffness_rows(
    config: Config,
    wall: Decision,
    push: Push | None,
    static: StaticStiffness | None,
    shaken: Shaken,
) -> list[Row]:
    fit, inertia = shaken.fit, config.belief().inertia
    gain = fit.acceleration * inertia.value
    gain_error = fit.acceleration_stderr * inertia.value
    bounds = f"{fit.acceleration * inertia.low:.3g} to {fit.acceleration * inertia.high:.3g}"
    by_inertia = f"with the believed inertia; {bounds} within its bounds"
    rows = []
    if static is None:
        note = (
            "not pushed: friction would hide a spring so soft"
            if push is None
            else "the spring gave way by less than the encoder can tell"
        )
        rows.append(Row("static stiffness", "N·m/rad", wall.stiffness, None, None, note))
    else:
        rows.append(
            Row(
                "static stiffness",
                "N·m/rad",
                wall.stiffness,
                static.stiffness,
                static.stiffness_stderr,
                "in commanded torque",
            )
        )
        rows.append(
            Row(
                "static stiffness, true",
                "N·m/rad",
                wall.stiffness,
                gain * static.stiffness,
                math.hypot(gain * static.stiffness_stderr, gain_error * static.stiffness),
                "times the torque gain",
            )
        )
    believed = config.belief().torque_gain.value
    rows.append(Row("torque gain", "1", believed, gain, gain_error, by_inertia))
    lost = lost_motion(fit)
    rows.append(
        Row("lost motion", "rad", 0.0, lost and lost[0], lost and lost[1], "at each turn: play")
    )
    return rows


def _free_rows(config: Config, shaken: Shaken, moved: Drag | None) -> list[Row]:
    belief = config.belief()
    gain = belief.torque_gain.value
    delay = from_command(shaken.fit, config.period_s)
    expected = (
        config.delay.steps * config.period_s
        + belief.delay.value
        + float(np.mean([step.age for step in delay.steps]))
    )
    return [
        Row("delay", "s", expected, delay.lag, delay.stderr, "from sample to motion"),
        Row(
            "drag, Coulomb",
            "N·m",
            belief.coulomb.value / gain,
            moved.coulomb if moved else None,
            moved.coulomb_stderr if moved else None,
            "in commanded torque; expected: model.coulomb" if moved else _NOT_MOVED,
        ),
        Row(
            "drag, viscous",
            "N·m·s/rad",
            belief.damping.value / gain,
            moved.viscous if moved else None,
            moved.viscous_stderr if moved else None,
            "in commanded torque; expected: model.damping" if moved else _NOT_MOVED,
        ),
    ]


def _contact_rows(
    approach: Approach | None,
    struck: Sequence[Contact],
    predicted: Sequence[Contact],
    worst: float,
) -> list[Row]:
    """By speed of approach: what comes of a contact, scaled to the mean speed of entry."""
    if approach is None:
        return []
    rows = []
    for wanted in approach.speeds:
        real = [c for c in struck if _nearest(approach, c) == wanted]
        simulated = [c for c in predicted if _nearest(approach, c) == wanted]
        if not real:
            note = "the shaft did not coast into the wall"
            rows.append(Row(f"contact at {wanted:.2g} rad/s", "rad", None, None, None, note))
            continue
        speed = float(np.mean([c.entry for c in real]))
        for name, (unit, values) in _VALUES.items():
            row = _row(f"{name} at {speed:.2f} rad/s", unit, speed, values, real, simulated)
            if unit == "1":
                said = f"; at the worst instant, without friction: {worst:.3g}"
                row = replace(row, note=row.note + said)
            if row.rendered is not None:
                rows.append(row)
    return rows


def _nearest(approach: Approach, contact: Contact) -> float:
    return min(approach.speeds, key=lambda speed: abs(speed - contact.entry))


_VALUES: dict[str, tuple[str, Callable[[Contact, float], float]]] = {
    "penetration": ("rad", lambda contact, speed: contact.penetration / contact.entry * speed),
    "peak torque": ("N·m", lambda contact, speed: contact.torque / contact.entry * speed),
    "exit/entry speed": ("1", lambda contact, _: contact.exit / contact.entry),
    "contact time": ("s", lambda contact, _: contact.seconds),
}
"""What is compared of contacts, scaled to one speed of entry [rad/s]"""


def _row(
    name: str,
    unit: str,
    speed: float,
    value: Callable[[Contact, float], float],
    real: Sequence[Contact],
    simulated: Sequence[Contact],
) -> Row:
    found = np.array([value(contact, speed) for contact in real])
    found = found[np.isfinite(found)]
    expected = np.array([value(contact, speed) for contact in simulated])
    expected = expected[np.isfinite(expected)]
    return Row(
        name,
        unit,
        float(np.mean(expected)) if expected.size else None,
        float(np.mean(found)) if found.size else None,
        float(np.std(found, ddof=1) / math.sqrt(found.size)) if found.size > 1 else None,
        f"{found.size} contacts; expected: simulated with model.*",
    )
