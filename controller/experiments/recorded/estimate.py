"""Identifies servo, friction and load from a recorded motion, and says what it cannot tell."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from haptic_wall.controller.experiments.estimated import Estimated
from haptic_wall.controller.experiments.identify.motion import Motion
from haptic_wall.controller.experiments.identify.standard_errors import standard_covariance
from haptic_wall.controller.experiments.recorded.choice import Judged, judged
from haptic_wall.controller.experiments.recorded.friction import (
    LONGEST_DELAY_S,
    MEANING,
    MODELS,
)
from haptic_wall.controller.experiments.recorded.record import (
    Record,
    is_too_slow,
    pieces_of,
    row_interval,
)
from haptic_wall.controller.experiments.recorded.shooting import (
    Shot,
    first_terms,
    fit,
    fit_anywhere,
)
from haptic_wall.controller.theory.checks import FloatArray

GRAVITY = 9.80665
ARM_SHARE, ARM_SHARE_STDERR = 0.04, 0.04
"""Mass of a pendulum's arm over that of its weight: mean and standard error. Rhoban's arm of 0.1 m
has 0.036 kg, for weights around 0.5 kg."""
SPREAD: Mapping[str, float] = {"inertia": 0.007, "damping": 0.35, "coulomb": 0.08}
"""Relative standard deviation of the values from swing to swing of one servo; that of the inertia
counts all that turns. Source: docs/evidence/recordings.md"""
FEW = 4
"""With fewer stretches than this the record does not show that spread itself"""
_SHORT_S = 0.5
_CORRELATED_S = 0.25
"""Correlation time of the errors of a swing [s]: what a friction model lacks lasts for a part of it
"""
_WEIGHED = 0.95
"""Largest fraction of the squares that a load must leave to be believed"""
_EXPLAINED = 1.2
"""Multiple of the rounding's residual up to which no richer friction is looked for"""
_MUCH_LEFT = 4.0
"""Multiple of the rounding's residual from which something else moves the shaft"""
_UNSCALED = frozenset({"delay", "gear", "fading"})
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
    """The estimates from a record; None: the record does not determine the value."""

    inertia: Estimated | None
    """Inertia of the servo, without a given pendulum [kg·m²]"""
    damping: Estimated | None
    """[N·m·s/rad]"""
    coulomb: Estimated | None
    """[N·m]"""
    delay: Estimated | None
    """[s]"""
    torque_gain: Estimated | None
    torque_constant: Estimated | None
    """Torque for each ampere recorded [N·m/A]"""
    inertia_total: Estimated | None
    """Inertia of all that turns [kg·m²]"""
    hanging: Estimated | None
    """Angle at which the load hangs [rad]"""
    friction_model: str | None
    friction: Mapping[str, Estimated]
    """Further parameters of that model"""
    models: tuple[Judged, ...]
    residual: float | None
    """Root mean square of what is left [rad]"""
    step: float
    """Encoder step [rad]; 0: none"""
    seconds: float
    """Length of what was fitted [s]"""
    stretches: tuple[Motion, ...]
    shot: Shot | None
    notes: tuple[str, ...]


def identify_record(record: Record, pendulum: Pendulum | None = None) -> Recorded:
    """Fit friction, load and delay to a recorded motion.

    Args:
        record: The motion.
        pendulum: Pendulum on the shaft; None: not known.
    """
    notes = list(record.notes)
    if not record.stretches or is_too_slow(record):
        notes.append(_why_nothing(record))
        return _nothing(record, notes)
    driven = any(stretch.driven for stretch in record.stretches)
    first = _first_fit(record, weighed=pendulum is not None or not driven)
    explained = first.rms <= _explained(record)
    models, best = judged(record.stretches, first, ("M1",) if explained else tuple(MODELS))
    whole, _ = pieces_of(record.stretches)
    shot = first
    name = next(each.name for each in models if each.chosen)
    if name != "M1":
        shot = fit_anywhere(whole, best, rounds=15)
    interval = float(np.median(np.diff(whole.motion.sampled)))
    spread = standard_covariance(shot.linear, interval, _CORRELATED_S)
    return _told(record, pendulum, shot, spread, name, models, notes)


def _first_fit(record: Record, *, weighed: bool) -> Shot:
    """Return the fit with Coulomb and viscous friction."""
    short, of = pieces_of(record.stretches, _SHORT_S, _SHORT_S)
    whole, _ = pieces_of(record.stretches)
    firsts = np.unique(of, return_index=True)[1]

    def fitted(weight: bool) -> Shot:
        near = fit(short, first_terms(record.stretches, weight=weight), rounds=15)
        at = None
        if len(whole.sampled) == firsts.size:
            at = near.own[:, firsts]
        return fit_anywhere(whole, near.terms, at, rounds=20, enough=_explained(record))

    with_weight = fitted(True)
    if weighed:
        return with_weight
    without = fitted(False)
    if with_weight.rms**2 < _WEIGHED * without.rms**2:
        return with_weight
    return without


def _explained(record: Record) -> float:
    """Return the residual that rounding explains [rad]."""
    return _EXPLAINED * record.step / math.sqrt(12.0)


def _why_nothing(record: Record) -> str:
    if record.stretches:
        return (
            f"nothing can be determined: the rows are {1e3 * row_interval(record):.3g} ms apart,"
            " wanted at most 50 ms"
        )
    return (
        "nothing can be determined: no part of the record has a motion with a known torque; wanted"
        " torque_nm or current_a, or torque_enabled 0 while the motor is off, in a part of some"
        " tenths of a second in which the shaft moves"
    )


def _nothing(record: Record, notes: list[str]) -> Recorded:
    return Recorded(*(None,) * 9, {}, (), None, record.step, 0.0, (), None, tuple(notes))


@dataclass(frozen=True, slots=True)
class _Scale:
    """From values per inertia to SI units."""

    record: Record
    pendulum: Pendulum | None
    names: tuple[str, ...]
    driven: bool

    def total(self, values: FloatArray, arm: float) -> float | None:
        """Return the inertia of all that turns [kg·m²]; None: not known."""
        terms = self._terms(values)
        if self.pendulum is not None:
            pull = math.hypot(terms.get("sine", 0.0), terms.get("cosine", 0.0))
            return self.pendulum.weight(arm) / pull if pull > 0.0 else None
        if self.driven and self.record.unit == "N·m" and terms["gain"] > 0.0:
            return 1.0 / terms["gain"]
        return None

    def value(self, name: str, values: FloatArray, arm: float) -> float:
        """Return one quantity in SI units; NaN: not known."""
        terms = self._terms(values)
        if name == "hanging":
            return math.atan2(-terms.get("cosine", 0.0), terms.get("sine", 0.0))
        if name in _UNSCALED:
            return terms.get(name, math.nan)
        total = self.total(values, arm)
        if total is None:
            return math.nan
        if name == "inertia_total":
            return total
        if name == "inertia":
            return total - (0.0 if self.pendulum is None else self.pendulum.inertia(arm))
        return terms.get(name, math.nan) * total

    def _terms(self, values: FloatArray) -> dict[str, float]:
        return {name: float(value) for name, value in zip(self.names, values, strict=True)}

    def estimated(self, name: str, shot: Shot, spread: FloatArray, more: float) -> Estimated | None:
        """Return one quantity with its standard error; None: not known.

        Args:
            name: Name of the quantity.
            shot: The fit.
            spread: Covariance of its parameters.
            more: A further, independent standard error, relative to the value (that of the
                inertia to the inertia of all that turns).
        """
        arm = ARM_SHARE
        value = self.value(name, shot.values, arm)
        if not math.isfinite(value):
            return None
        gradient = np.empty(shot.values.size)
        for at, each in enumerate(shot.values):
            small = 1e-5 * max(abs(float(each)), 1e-3)
            sides = [shot.values.copy() for _ in range(2)]
            sides[0][at] += small
            sides[1][at] -= small
            up, down = (self.value(name, side, arm) for side in sides)
            gradient[at] = (up - down) / (2.0 * small)
        error = math.sqrt(max(float(gradient @ spread @ gradient), 0.0))
        of_arm = self.value(name, shot.values, arm + ARM_SHARE_STDERR) - value
        size = self.value("inertia_total", shot.values, arm) if name == "inertia" else value
        return Estimated(value, math.sqrt(error**2 + of_arm**2 + (more * size) ** 2))


def _told(
    record: Record,
    pendulum: Pendulum | None,
    shot: Shot,
    spread: FloatArray,
    name: str,
    models: tuple[Judged, ...],
    notes: list[str],
) -> Recorded:
    driven = any(stretch.driven for stretch in record.stretches)
    scale = _Scale(record, pendulum, shot.names, driven)
    few = len(record.stretches) < FEW and not (driven and len(shot.pieces.sampled) >= FEW)

    def found(quantity: str) -> Estimated | None:
        more = SPREAD.get(quantity.removesuffix("_total"), 0.0) if few else 0.0
        return scale.estimated(quantity, shot, spread, more)

    known = {each: found(each) for each in ("inertia", "damping", "coulomb", "inertia_total")}
    hanging = found("hanging") if "sine" in shot.names else None
    delay, gain, constant = None, None, None
    terms = shot.terms
    if driven:
        delay = found("delay")
        gain = found("gain") if pendulum is not None else None
        if record.unit == "A":
            gain, constant = None, gain
    inertia = known["inertia"]
    if inertia is not None and 2.0 * inertia.stderr >= inertia.value:
        notes.append(
            f"the servo's own inertia cannot be determined: {inertia.value:.2g} kg·m² with a"
            f" standard error of {inertia.stderr:.2g}"
            + ("" if pendulum is None else "; check the pendulum's mass and length")
        )
        known["inertia"] = None
    notes += _notes(record, pendulum, shot, models, driven=driven, few=few)
    if driven and terms["gain"] <= 0.0:
        notes.append("the torque acts against its sign: check the sign of its column")
        known = dict.fromkeys(known)
        gain = constant = delay = None
    more = {}
    for term in MODELS[name][2:]:
        each = found(term.name)
        if each is not None:
            more[term.name] = each
    return Recorded(
        known["inertia"],
        known["damping"],
        known["coulomb"],
        delay,
        gain,
        constant,
        known["inertia_total"],
        hanging,
        name,
        more,
        models,
        shot.rms,
        record.step,
        float(sum(each.sampled[-1] - each.sampled[0] for each in record.stretches)),
        record.stretches,
        shot,
        tuple(notes),
    )


def _notes(
    record: Record,
    pendulum: Pendulum | None,
    shot: Shot,
    models: tuple[Judged, ...],
    *,
    driven: bool,
    few: bool,
) -> list[str]:
    """Return notes on values that the record does not determine, with the reason."""
    notes = []
    terms = shot.terms
    name = next(each.name for each in models if each.chosen)
    if not driven:
        notes.append(
            "the motor is off in all fitted parts: delay and torque gain cannot be determined"
        )
        if pendulum is None:
            notes.append(
                "without torque or a known pendulum there is no scale: inertia, damping and Coulomb"
                " friction cannot be determined, only damping / inertia ="
                f" {terms['damping']:.3g} 1/s and Coulomb friction / inertia ="
                f" {terms['coulomb']:.3g} rad/s²"
            )
    elif pendulum is None:
        if record.unit == "N·m":
            notes.append(
                "without a known pendulum the torque gain cannot be determined: all values are in"
                " the unit of the recorded torque"
            )
        else:
            notes.append(
                "without a known pendulum a current has no scale: inertia, damping and Coulomb"
                " friction cannot be determined"
            )
    if pendulum is not None:
        notes.append(
            f"the arm's own mass is assumed to be {100 * ARM_SHARE:.0f} ±"
            f" {100 * ARM_SHARE_STDERR:.0f} % of the pendulum's"
        )
    if few:
        shares = ", ".join(
            f"{100 * share:g} % of the {'whole inertia' if each == 'inertia' else each}"
            for each, share in SPREAD.items()
        )
        notes.append(
            f"there are too few swings to measure the variation between them: {shares} are added"
            " to the standard errors, as measured on an XL330"
        )
    if models[0].predicted is None and len(models) > 1:
        notes.append("the record is too short to decide which friction model predicts better")
    rounding = record.step / math.sqrt(12.0)
    if rounding > 0.0 and shot.rms > _MUCH_LEFT * rounding:
        notes.append(
            f"the residual is {1e3 * shot.rms:.2g} mrad rms, of which rounding explains"
            f" {1e3 * rounding:.2g} mrad: {MEANING[name]} do not explain all"
        )
    if driven and terms["delay"] >= 0.98 * LONGEST_DELAY_S:
        notes.append(f"the delay is {LONGEST_DELAY_S:g} s or more: it cannot be determined")
    return notes
