"""Compares commanded or expected values with the rendered ones, as lines of a report."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np

from haptic_wall.controller.experiments.delay import Moved
from haptic_wall.controller.experiments.identify.fitting import Fit
from haptic_wall.controller.experiments.rendered.contact_transient import Approach, Contact
from haptic_wall.controller.experiments.rendered.static_stiffness import Push, StaticStiffness
from haptic_wall.controller.settings.config import Config


@dataclass(frozen=True, slots=True)
class Comparison:
    """One line: a commanded value, the rendered one and its uncertainty."""

    name: str
    unit: str
    commanded: float | None
    """Commanded value, or the expected one if nothing is commanded; None: neither is known"""
    rendered: float | None
    """Measured value; None: it could not be measured, and the note says why"""
    stderr: float | None
    note: str = ""

    @property
    def ratio(self) -> float | None:
        """Return the ratio of rendered to commanded; None if undefined."""
        if self.rendered is None or not self.commanded:
            return None
        return self.rendered / self.commanded

    def report(self) -> dict[str, Any]:
        """Return the line for JSON."""
        return {**asdict(self), "ratio": self.ratio}


def stiffness_rows(
    config: Config,
    stiffness: float,
    push: Push | None,
    static: StaticStiffness | None,
    fit: Fit,
) -> list[Comparison]:
    """Return lines for the stiffness in commanded and in true torque, torque gain and backlash.

    Args:
        config: The belief.
        stiffness: Commanded [N·m/rad].
        push: Plan of the static measurement; None: it was not possible.
        static: Result of the static measurement; None: there is none.
        fit: Fit of the free shaft's motions.
    """
    inertia = config.belief().inertia
    gain = inertia.value / fit.inertia
    gain_error = gain * fit.stderr[0] / fit.inertia
    bounds = f"{inertia.low / fit.inertia:.3g} to {inertia.high / fit.inertia:.3g}"
    by_inertia = f"with the believed inertia; {bounds} within its bounds"
    rows = []
    if static is None:
        note = (
            "not measured: friction hides so soft a spring"
            if push is None
            else "the encoder does not resolve the spring's deflection"
        )
        rows.append(Comparison("static stiffness", "N·m/rad", stiffness, None, None, note))
    else:
        rows.append(
            Comparison(
                "static stiffness",
                "N·m/rad",
                stiffness,
                static.stiffness,
                static.stiffness_stderr,
                "in commanded torque",
            )
        )
        rows.append(
            Comparison(
                "static stiffness, true",
                "N·m/rad",
                stiffness,
                gain * static.stiffness,
                math.hypot(gain * static.stiffness_stderr, gain_error * static.stiffness),
                "times the torque gain",
            )
        )
    believed = config.belief().torque_gain.value
    rows.append(Comparison("torque gain", "1", believed, gain, gain_error, by_inertia))
    error = fit.stderr[4] if fit.backlash else None
    note = "between shaft and encoder" if fit.backlash else "not visible"
    rows.append(Comparison("backlash", "rad", 0.0, fit.backlash, error, note))
    return rows


def free_rows(config: Config, moved: Moved) -> list[Comparison]:
    """Return lines for the delay and the free shaft's friction, compared to the belief."""
    belief, fit = config.belief(), moved.fit
    gain = belief.torque_gain.value
    expected = moved.wait + belief.delay.value
    note = "in commanded torque; expected: model."
    return [
        Comparison(
            "delay", "s", expected, moved.total.value, moved.total.stderr, "from sample to motion"
        ),
        *(
            Comparison(f"drag, {word}", unit, believed / gain, found, error, f"{note}{name}")
            for word, unit, name, believed, found, error in (
                ("Coulomb", "N·m", "coulomb", belief.coulomb.value, fit.coulomb, fit.stderr[2]),
                ("viscous", "N·m·s/rad", "damping", belief.damping.value, *fit.weaker),
            )
        ),
    ]


def contact_rows(
    approach: Approach | None,
    struck: Sequence[Contact],
    predicted: Sequence[Contact],
    worst: float,
) -> list[Comparison]:
    """Return lines for the contacts at each approach speed, scaled to their mean entry speed.

    Args:
        approach: The plan; None: there was no wall.
        struck: Contacts of the servo.
        predicted: Contacts of a simulated servo.
        worst: Largest ratio of exit to entry speed that the theory allows without friction.
    """
    if approach is None:
        return []
    rows = []
    for wanted in approach.speeds:
        real = [c for c in struck if _nearest(approach, c) == wanted]
        simulated = [c for c in predicted if _nearest(approach, c) == wanted]
        if not real:
            note = "the shaft did not coast into the wall"
            rows.append(Comparison(f"contact at {wanted:.2g} rad/s", "rad", None, None, None, note))
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
"""Compared quantities of contacts, scaled to one speed of entry [rad/s]"""


def _row(
    name: str,
    unit: str,
    speed: float,
    value: Callable[[Contact, float], float],
    real: Sequence[Contact],
    simulated: Sequence[Contact],
) -> Comparison:
    found = np.array([value(contact, speed) for contact in real])
    found = found[np.isfinite(found)]
    expected = np.array([value(contact, speed) for contact in simulated])
    expected = expected[np.isfinite(expected)]
    return Comparison(
        name,
        unit,
        float(np.mean(expected)) if expected.size else None,
        float(np.mean(found)) if found.size else None,
        float(np.std(found, ddof=1) / math.sqrt(found.size)) if found.size > 1 else None,
        f"{found.size} contacts; expected: simulated with model.*",
    )
