"""Identifies servo, friction and load from a recorded motion, and says what it cannot tell."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np

from haptic_wall.controller.experiments.estimated import Estimated
from haptic_wall.controller.experiments.identify.fit import Fit
from haptic_wall.controller.experiments.identify.motion import Motion
from haptic_wall.controller.experiments.recorded.friction import (
    LONGEST_DELAY_S,
    MEANING,
    MODELS,
)
from haptic_wall.controller.experiments.recorded.record import Record, pieces_of
from haptic_wall.controller.experiments.recorded.shooting import PIECE_S, first_terms, fit, judged
from haptic_wall.controller.theory.checks import FloatArray

GRAVITY = 9.80665
ARM_SHARE, ARM_SHARE_STDERR = 0.04, 0.04
"""Mass of a pendulum's arm over that of its weight: mean and standard error. Rhoban's arm of 0.1 m
has 0.036 kg, for weights around 0.5 kg."""
SPREAD: Mapping[str, float] = {"inertia_total": 0.007, "damping": 0.35, "coulomb": 0.08}
"""Relative standard deviation of the values from swing to swing of one servo. Source:
docs/evidence/recordings.md"""
_LONGEST_ROW_S = 0.05
"""Rows that are further apart cannot show a servo's motion [s]"""
FEW = 4
"""With fewer stretches than this the record does not show that spread itself"""
_WEIGHED = 0.95
"""Largest fraction of the squares that a load must leave to be believed"""
_EXPLAINED = 1.2
"""Multiple of the rounding's residual up to which no richer friction is looked for"""
_MUCH_LEFT = 4.0
"""Multiple of the rounding's residual from which something else moves the shaft"""
_UNSCALED = ("delay", "gear", "fading")
"""Parameters that are the same per inertia"""


@dataclass(frozen=True, slots=True)
class Pendulum:
    """A known weight on an arm whose own mass is not known."""

    mass: float
    """[kg]"""
    length: float
    """From the axis to the weight's centre [m]"""

    def weight(self, arm: float) -> float:
        """Return the torque of a horizontal pendulum [N·m]; ``arm`` as ``ARM_SHARE``."""
        return GRAVITY * self.length * self.mass * (1.0 + 0.5 * arm)

    def inertia(self, arm: float) -> float:
        """Return its inertia [kg·m²]."""
        return self.mass * self.length**2 * (1.0 + arm / 3.0)


@dataclass(frozen=True, slots=True)
class Recorded:
    """The estimates from a record."""

    known: Mapping[str, Estimated]
    """What the record determines, in SI units: ``inertia`` of the servo without a given pendulum,
    ``inertia_total`` of all that turns, ``damping``, ``coulomb``, ``delay``, ``torque_gain``,
    ``torque_constant`` for each recorded ampere, ``hanging`` (angle at which the load hangs), and
    further parameters of the friction model"""
    models: Mapping[str, Fit]
    """Friction models that were tried, each with its fit to pieces of a second"""
    chosen: str | None
    """Name of the model that was chosen"""
    shot: Fit | None
    """The fit; None: nothing can be determined"""
    stretches: tuple[Motion, ...]
    """Stretches of the record to which the model was fitted"""
    step: float
    """Encoder step [rad]; 0: none"""
    notes: tuple[str, ...]

    @property
    def friction(self) -> dict[str, Estimated]:
        """Return the parameters of the friction model beside damping and Coulomb friction."""
        names = MODELS[self.chosen][2:] if self.chosen else ()
        return {name: self.known[name] for name in names if name in self.known}

    @property
    def residual(self) -> float | None:
        """Return the root mean square of what is left [rad]."""
        return None if self.shot is None else self.shot.residual

    @property
    def seconds(self) -> float:
        """Return the length of what was fitted [s]."""
        return float(sum(each.sampled[-1] - each.sampled[0] for each in self.stretches))


def identify_record(record: Record, pendulum: Pendulum | None = None) -> Recorded:
    """Fit friction, load and delay to a recorded motion.

    Args:
        record: The motion.
        pendulum: Pendulum on the shaft; None: not known.
    """
    stretches = record.stretches
    if (why := _why_nothing(stretches)) is not None:
        return Recorded({}, {}, None, None, (), record.step, (*record.notes, why))
    driven = any(stretch.driven for stretch in stretches)
    pieces, _ = pieces_of(stretches, PIECE_S, PIECE_S)
    whole, _ = pieces_of(stretches)

    def fitted(weight: bool) -> tuple[Fit, Fit]:
        near = fit(pieces, first_terms(stretches, weight=weight), rounds=20)
        return near, fit(whole, near.terms, rounds=20)

    near, shot = fitted(True)
    if pendulum is None and driven:
        others = fitted(False)
        if shot.residual**2 >= _WEIGHED * others[1].residual ** 2:
            near, shot = others
    chosen, models = "M1", {"M1": near}
    if shot.residual > _EXPLAINED * record.step / math.sqrt(12.0):
        begun = first_terms(stretches, weight="sine" in near.terms)
        chosen, models = judged(pieces, near, begun)
        again = fit(whole, models[chosen].terms, rounds=20)
        shot = again if chosen != "M1" or again.residual < shot.residual else shot
    few = len(stretches) < FEW and not (driven and len(shot.pieces.sampled) >= FEW)
    scale = _Scale(shot.names, record.unit if driven else None, pendulum)
    known = _known(scale, shot, few)
    notes = [*record.notes, *_notes(scale, shot, chosen, record.step, few)]
    inertia = known.get("inertia")
    if inertia is not None and 2.0 * inertia.stderr >= inertia.value:
        notes.append(
            f"the servo's own inertia cannot be determined: {inertia.value:.2g} kg·m² with a"
            f" standard error of {inertia.stderr:.2g}"
            + ("" if pendulum is None else "; check the pendulum's mass and length")
        )
        del known["inertia"]
    if "hanging" in known and known["hanging"].stderr > 0.5 * math.pi:
        notes.append("the angle at which the load hangs cannot be determined")
        del known["hanging"]
    if driven and shot.terms["gain"] <= 0.0:
        notes.append("the torque acts against its sign: check the sign of its column")
        known = {name: each for name, each in known.items() if name == "hanging"}
    return Recorded(known, models, chosen, shot, stretches, record.step, tuple(notes))


def _why_nothing(stretches: tuple[Motion, ...]) -> str | None:
    """Say why a record shows no motion of a servo; None: it does."""
    if not stretches:
        return (
            "nothing can be determined: no part of the record has a motion with a known torque;"
            " wanted torque_nm or current_a, or torque_enabled 0 while the motor is off, in a part"
            " of some tenths of a second in which the shaft moves"
        )
    apart = float(np.median(np.concatenate([np.diff(each.sampled) for each in stretches])))
    if apart > _LONGEST_ROW_S:
        return (
            f"nothing can be determined: the rows are {apart:.3g} s apart, wanted at most"
            f" {_LONGEST_ROW_S:g} s; is time_s in seconds?"
        )
    return None


@dataclass(frozen=True, slots=True)
class _Scale:
    """From values per inertia to SI units."""

    names: tuple[str, ...]
    """Of the values"""
    unit: str | None
    """Unit of the recorded torque; None: the motor is off"""
    pendulum: Pendulum | None

    def quantities(self, values: FloatArray, arm: float) -> dict[str, float]:
        """Return all that is known, in SI units, for values of shape (names,)."""
        terms = dict(zip(self.names, values.tolist(), strict=True))
        found = {name: terms[name] for name in _UNSCALED if name in terms}
        sine, cosine, gain = (terms.pop(name, 0.0) for name in ("sine", "cosine", "gain"))
        pull, own = math.hypot(sine, cosine), 0.0
        if "sine" in self.names:
            found["hanging"] = math.atan2(-cosine, sine)
        if self.pendulum is not None and pull > 0.0:
            own, total = self.pendulum.inertia(arm), self.pendulum.weight(arm) / pull
            if self.unit is not None:
                found["torque_constant" if self.unit == "A" else "torque_gain"] = gain * total
        elif self.pendulum is None and self.unit == "N·m" and gain > 0.0:
            total = 1.0 / gain
        else:
            return found
        scaled = {name: total * each for name, each in terms.items() if name not in _UNSCALED}
        return {**found, **scaled, "inertia": total - own, "inertia_total": total}


def _known(scale: _Scale, shot: Fit, few: bool) -> dict[str, Estimated]:
    """Return all quantities that are known, with their standard errors.

    Args:
        scale: Has the pendulum, whose arm is uncertain too.
        shot: The fit.
        few: The spread from swing to swing is added.
    """
    values = np.array(list(shot.terms.values()))
    count = values.size
    covariance = np.zeros((count + 1, count + 1))
    covariance[:count, :count] = shot.covariance
    covariance[count, count] = ARM_SHARE_STDERR**2
    at = np.append(values, ARM_SHARE)
    steps = 1e-5 * np.maximum(np.abs(at), 1e-3)
    here = scale.quantities(values, ARM_SHARE)
    slopes = {name: np.zeros(count + 1) for name in here}
    for n, step in enumerate(steps):
        up, down = (at + side * step * (np.arange(count + 1) == n) for side in (1.0, -1.0))
        more, less = (scale.quantities(each[:-1], float(each[-1])) for each in (up, down))
        for name, slope in slopes.items():
            slope[n] = (more.get(name, math.nan) - less.get(name, math.nan)) / (2.0 * step)
    found = {}
    for name, slope in slopes.items():
        # Of the inertia counts the spread of all that turns.
        of = "inertia_total" if name == "inertia" else name
        spread = SPREAD.get(of, 0.0) * here[of] if few else 0.0
        variance = max(float(slope @ covariance @ slope), 0.0) + spread**2
        found[name] = Estimated(here[name], math.sqrt(variance))
    return found


def _notes(scale: _Scale, shot: Fit, model: str, step: float, few: bool) -> Iterator[str]:
    """Yield notes on values that the record does not determine, with the reason."""
    terms, unscaled = shot.terms, "inertia, damping and Coulomb friction cannot be determined"
    if scale.unit is None:
        yield "the motor is off in all fitted parts: delay and torque gain cannot be determined"
    if scale.pendulum is not None:
        yield (
            f"the arm's own mass is assumed to be {100 * ARM_SHARE:.0f} ±"
            f" {100 * ARM_SHARE_STDERR:.0f} % of the pendulum's"
        )
    elif scale.unit is None:
        yield (
            f"without torque or a known pendulum there is no scale: {unscaled}, only damping /"
            f" inertia = {terms['damping']:.3g} 1/s and Coulomb friction / inertia ="
            f" {terms['coulomb']:.3g} rad/s²"
        )
    elif scale.unit == "N·m":
        yield (
            "without a known pendulum the torque gain cannot be determined: all values are in the"
            " unit of the recorded torque"
        )
    else:
        yield f"without a known pendulum a current has no scale: {unscaled}"
    if few:
        words = {"inertia_total": "whole inertia", "coulomb": "Coulomb friction"}
        shares = ", ".join(
            f"{100 * share:g} % of the {words.get(name, name)}" for name, share in SPREAD.items()
        )
        yield (
            f"there are too few swings to measure the variation between them: {shares} are added"
            " to the standard errors, as measured on an XL330"
        )
    rounding = step / math.sqrt(12.0)
    if 0.0 < _MUCH_LEFT * rounding < shot.residual:
        yield (
            f"the residual is {1e3 * shot.residual:.2g} mrad rms, of which rounding explains"
            f" {1e3 * rounding:.2g} mrad: {MEANING[model]} do not explain all"
        )
    if terms.get("delay", 0.0) >= 0.98 * LONGEST_DELAY_S:
        yield f"the delay is {LONGEST_DELAY_S:g} s or more: it cannot be determined"
