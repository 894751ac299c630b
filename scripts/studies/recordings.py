"""Fits a real XL330's recordings, predicts the other ones, and checks the bounds.

    scripts/study recordings [--draws N]

The recordings lie in docs/examples/xl330-pendulum.
"""

from __future__ import annotations

import math
from itertools import combinations
from typing import NamedTuple

import numpy as np

from haptic_wall.controller.experiments.identify.fit import Fit
from haptic_wall.controller.experiments.identify.motion import taken
from haptic_wall.controller.experiments.recorded.estimate import identify_record
from haptic_wall.controller.experiments.recorded.friction import MODELS
from haptic_wall.controller.experiments.recorded.record import pieces_of, record_of
from haptic_wall.controller.experiments.recorded.shooting import first_terms, fit, start_with
from haptic_wall.controller.theory.checks import FloatArray
from scripts.recorded_motions import (
    DRIVEN,
    DROPS,
    PENDULUM,
    driven,
    drop,
    error_of,
    made,
    predicted,
)
from scripts.study import Found, Given, Option, Part, Study, table

EXTRA = {"M1 + drag": {"drag": 0.02}}
"""Models besides bam's, with what they add"""
PREDICTING = ("M1", "M3")
"""Models that are tried where the motor is on"""
STRIBECK_DRAWS = 5
"""Each such draw also swings with friction that fades"""
SHORT_S = 0.5
_LITTLE = 1e-3
"""Share of a new term's usual start"""
DRIVEN_PIECE_S = 1.0


class Drop(NamedTuple):
    """A fit of one model to some drops."""

    inertia: float
    """Inertia of all that turns, with a weightless arm [kg·m²]"""
    damping: float
    """[N·m·s/rad]"""
    coulomb: float
    """[N·m]"""
    more: dict[str, float]
    """Further parameters, in SI units or per inertia"""
    left: dict[str, float]
    """Of each drop that was fitted [rad rms]"""
    predicted: dict[str, float]
    """Prediction error of each drop, from its first 0.2 s [rad rms]"""


def swings(names: tuple[str, ...], model: str) -> Fit:
    """Fit a model to whole drops, from the fit of Coulomb and viscous friction."""
    stretches = tuple(each for name in names for each in drop(name))
    short, of = pieces_of(stretches, SHORT_S, SHORT_S)
    whole, _ = pieces_of(stretches)
    first = np.unique(of, return_index=True)[1]
    near = fit(short, first_terms(stretches, weight=True), rounds=15)
    at = near.own[:, first]
    shot = fit(whole, near.terms, at, rounds=25)
    if model == "M1":
        return shot
    found = []
    for terms in (shot.terms, near.terms):
        start = start_with(model, terms) if model in MODELS else {**terms, **EXTRA[model]}
        # from the plain fit, and from one to short pieces, where there are fewer minima
        found.append(fit(whole, start, shot.own, rounds=25))
        close = fit(short, start, rounds=15)
        at = close.own[:, first]
        found.append(fit(whole, close.terms, at, rounds=25))
    return min(found, key=lambda each: each.residual)


def dropped(case: tuple[str, tuple[str, ...]]) -> Drop:
    """Fit one model to some drops, and predict all."""
    model, names = case
    shot = swings(names, model)
    terms = shot.terms
    total = PENDULUM.weight(0.0) / math.hypot(terms["sine"], terms["cosine"])
    left, ahead = {}, {}
    for place, name in enumerate(names):
        part = taken(shot.pieces, np.arange(len(names)) == place)
        left[name] = error_of(part, shot.fitted[place : place + 1])
    for name in DROPS:
        pieces, _ = pieces_of(drop(name))
        ahead[name] = error_of(pieces, predicted(pieces, terms))
    basic = ("sine", "cosine", "damping", "coulomb")
    more = {name: value for name, value in terms.items() if name not in basic}
    for name in ("excess", "drag"):
        if name in more:
            more[name] *= total
    return Drop(total, terms["damping"] * total, terms["coulomb"] * total, more, left, ahead)


def _cases(_given: object) -> list[tuple[str, tuple[str, ...]]]:
    groups = [each for count in (1, 2) for each in combinations(DROPS, count)]
    return [(model, group) for model in (*MODELS, *EXTRA) for group in groups]


def _named(names: tuple[str, ...]) -> str:
    return "both" if len(names) == len(DROPS) else names[0].split("_")[0]


def drop_lines(found: Found[tuple[str, tuple[str, ...]], Drop]) -> list[str]:
    """The table of fits and predictions."""
    rows = []
    for (model, names), row in found:
        more = ", ".join(
            f"{name.replace('_', ' ')} {value:.3g}" for name, value in row.more.items()
        )
        cells = [model, _named(names), f"{1e3 * row.inertia:.3f}", f"{1e3 * row.damping:.2f}"]
        cells += [f"{1e3 * row.coulomb:.1f}", more or "–"]
        for name in DROPS:
            text = f"{1e3 * row.predicted[name]:.1f}"
            if name in row.left:
                text = f"fitted: {1e3 * row.left[name]:.1f}"
            cells.append(text)
        rows.append(cells)
    head = ["friction", "fitted to", "whole inertia [g·m²]", "damping [mN·m·s/rad]"]
    head += ["Coulomb friction [mN·m]", "more", "kp100 [mrad]", "kp400 [mrad]"]
    return table(head, *rows)


class Left(NamedTuple):
    """Residuals of recordings in position mode."""

    fitted: float
    """Residual of the fitted recordings, in pieces of 0.5 s [rad rms]"""
    predicted: float
    """Error of the predicted recording, in pieces of 1 s, each from its first 0.2 s [rad rms]"""
    load: float | None
    """Share of the gear's load in the friction"""


def out_of(name: str) -> dict[str, Left]:
    """Fit each model to all driven recordings but one, and predict that one."""
    stretches = tuple(driven(each) for each in DRIVEN if each != name)
    pieces, _ = pieces_of(stretches, SHORT_S, SHORT_S)
    rest, _ = pieces_of((driven(name),), DRIVEN_PIECE_S, DRIVEN_PIECE_S)
    begun = first_terms(stretches, weight=True)
    terms = begun
    at: FloatArray | None = None
    found: dict[str, Left] = {}
    for model in PREDICTING:
        shots = []
        usual = start_with(model, {**terms, "coulomb": begun["coulomb"]})
        known = {n: v for n, v in start_with(model, terms).items() if n in terms}
        # With the usual new terms, with next to none (as the model before), and from the
        # regression: the best fit of a simpler model may lie in another valley.
        little = {name: _LITTLE * value for name, value in usual.items()} | known
        starts = [(usual, at), (little, at)]
        if found:
            starts.append((start_with(model, begun), None))
        for start, own in starts:
            shots.append(fit(pieces, start, own, rounds=25))
        shot = min(shots, key=lambda each: each.residual)
        terms, at = shot.terms, shot.own
        left = error_of(rest, predicted(rest, terms))
        found[model] = Left(shot.residual, left, shot.terms.get("gear"))
    return found


def out_lines(found: Found[str, dict[str, Left]]) -> list[str]:
    """The table of predictions, a line for each recording left out, a column for each model."""
    rows = []
    for name, row in found:
        rows.append([name, *(f"{1e3 * row[model].predicted:.1f}" for model in PREDICTING)])
    for kind in ("predicted", "fitted"):
        means = []
        for model in PREDICTING:
            squares = [getattr(row[model], kind) ** 2 for _, row in found]
            means.append(f"{1e3 * math.sqrt(float(np.mean(squares))):.1f}")
        rows.append([f"all, {kind}", *means])
    return table(["left out", *(f"{model} [mrad]" for model in PREDICTING)], *rows)


class Check(NamedTuple):
    """Errors of one synthetic recording, in standard errors; and relative standard errors."""

    off: dict[str, float]
    wide: dict[str, float]
    model: str | None


def checked(case: tuple[str, int]) -> Check:
    """Identify one synthetic recording."""
    kind, seed = case
    motion = made(seed, torque=kind == "known torque", stribeck="Stribeck" in kind)
    found = identify_record(record_of(motion.columns), motion.pendulum)
    off, wide = {}, {}
    for name, true in motion.truth.items():
        each = found.known.get(name)
        if each is not None:
            off[name] = (each.value - true) / each.stderr
            wide[name] = each.stderr / true
    return Check(off, wide, found.chosen)


KINDS = ("free swing", "known torque", "free swing, Stribeck")
FIRST = 3000


def _drawn(given: Given) -> list[tuple[str, int]]:
    found = [(kind, FIRST + n) for kind in KINDS[:2] for n in range(given.draws)]
    return found + [(KINDS[2], FIRST + n) for n in range(0, given.draws, STRIBECK_DRAWS)]


def check_lines(found: Found[tuple[str, int], Check]) -> list[str]:
    """The table of how often the truth lies within two standard errors."""
    rows = []
    names = ("inertia", "damping", "coulomb", "delay", "torque_gain")
    for kind in KINDS:
        every = [row for (of, _), row in found if of == kind]
        cells = [kind, str(len(every))]
        for name in names:
            off = [row.off[name] for row in every if name in row.off]
            if not off:
                cells.append("–")
                continue
            inside = sum(abs(each) <= 2.0 for each in off)
            wide = float(np.median([row.wide[name] for row in every if name in row.wide]))
            cells.append(f"{inside} of {len(off)}, {100 * wide:.2g} %")
        richer = sum(row.model != "M1" for row in every)
        rows.append([*cells, f"{richer}"])
    head = ["motion", "draws", *(name.replace("_", " ") for name in names), "another model than M1"]
    return table(head, *rows)


STUDY = Study(
    "evidence/recordings.md",
    (
        Part("drops", _cases, dropped, drop_lines, case_s=10.0),
        Part(
            "driven",
            lambda _given: DRIVEN,
            out_of,
            out_lines,
            case_s=10.0,
        ),
        Part(
            "bounds",
            _drawn,
            checked,
            check_lines,
            case_s=2.0,
        ),
    ),
    (Option("draws", 200, "synthetic recordings of each kind", quick=2),),
    everywhere=True,
)
