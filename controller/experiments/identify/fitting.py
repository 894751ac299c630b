"""Fits a servo's inertia, friction and delay to its motion: output error, with standard errors.

The motion is divided at moments of high speed into pieces with their own initial states, so that
unmodelled effects do not accumulate beyond a piece. The least squares start from a regression on
smoothed data, which assumes only the form of the model.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Mapping, Sequence

import numpy as np

from haptic_wall.controller.experiments.identify.fit import NAMES, VALUES, Fit
from haptic_wall.controller.experiments.identify.motion import Motion, pieces_of
from haptic_wall.controller.experiments.identify.output_error import (
    OutputError,
    Prior,
)
from haptic_wall.controller.experiments.identify.start import smoothed, start_of
from haptic_wall.controller.theory.checks import FloatArray

PIECE_S = 0.4
"""Approximate length of a piece [s]: long compared with the servo's oscillations, short compared
with its drift"""
_LEAST_S = 1.0
"""Least length of all pieces [s]"""
_SLOWEST, _TURN_S = 0.15, 4e-3
"""Of a stretch in one direction: least speed [rad/s]; time near a turn that is left out [s]"""
_SHORTEST_S, _TRAVEL = 0.025, 10.0
"""Its least length [s], and travel [counts]"""
_STALL = 4.5
"""Periods without a sample that end a piece [1]; shorter gaps are lost replies"""
_FEWEST = 500
"""Least number of samples"""
_AT_FIRST = 0.05
"""Least friction per inertia at the start"""
_LATEST_S = 0.03
"""Longest delay in the search for the start [s]"""
_VISIBLE = 4.0
"""Least ratio of a visible backlash to its standard error"""
_LEAST_BACKLASH, _MOST_BACKLASH = 1e-6, 0.1
"""Smallest and largest backlash [rad]: stretches of one direction fit any"""
_UNQUANTISED = 1e-5
"""Largest negligible residual of a servo without an encoder step [rad]"""


class NoFitError(Exception):
    """The motion does not show what the model needs; the message says what is missing."""


def rounding_of(step: float) -> float:
    """Return the root mean square residual of rounding to an encoder step alone [rad]."""
    return step / math.sqrt(12.0) or _UNQUANTISED


def begun(motion: Motion, step: float, *, turns: bool = True) -> Fit:
    """Return the start of a fit to the pieces of a motion.

    Args:
        motion: A motion; the shaft moves for at least two seconds.
        step: One count of the encoder [rad]; 0: not quantised.
        turns: The pieces contain the turns of the shaft; else they are stretches in one direction.

    Raises:
        NoFitError: The motion is not sufficient.
    """
    speed = moving(motion)
    cut = cuts_of if turns else _stretches
    cuts = list(cut(motion, speed, max(step, 1e-6)))
    seconds = sum(float(motion.sampled[b - 1] - motion.sampled[a]) for a, b in cuts)
    if seconds < _LEAST_S:
        raise NoFitError(
            f"the shaft moved in {seconds:.1f} s only, wanted at least {_LEAST_S:.1f} s"
        )
    found = start_of([motion], np.arange(0.0, _LATEST_S, 2.5e-4).tolist())
    if found["gain"] <= 0.0:
        raise NoFitError("the sent torque does not accelerate the shaft")
    inertia = 1.0 / found["gain"]
    values = {
        **dict.fromkeys(VALUES, 0.0),
        "inertia": inertia,
        # Values that cannot be distinguished at the start begin just above zero.
        "damping": inertia * max(found["damping"], _AT_FIRST),
        "coulomb": inertia * max(found["coulomb"], _AT_FIRST),
        "delay": found["delay"],
    }
    speeds = np.array([[speed[begin] for begin, _ in cuts]])
    return Fit(values, NAMES[:4], pieces_of(motion, cuts), speeds)


def visible_backlash(
    without: Fit, priors: Mapping[str, Prior] | None = None, *, thorough: bool = True
) -> Fit | None:
    """Return the fit with backlash; None: no backlash is visible.

    Args:
        without: The fit without.
        priors: As for it.
        thorough: As for it.
    """
    least, most = _LEAST_BACKLASH, _MOST_BACKLASH
    begun = without.having(backlash=min(max(2.0 * without.residual, least), most))
    found = fitted(begun, priors, thorough)
    visible = found["backlash"] > _VISIBLE * found.error("backlash") + least
    better = found.residual < without.residual and found["backlash"] < most
    return found if visible and better else None


def moving(motion: Motion) -> FloatArray:
    """Return the speed at each sample, over a window of samples [rad/s].

    Raises:
        NoFitError: There is hardly any motion.
    """
    found = smoothed(motion) if motion.sampled.size >= _FEWEST else None
    if found is None:
        raise NoFitError(
            f"only {motion.sampled.size} samples were recorded, wanted at least {_FEWEST}"
        )
    return found[0]


def cuts_of(motion: Motion, speed: FloatArray, step: float) -> list[tuple[int, int]]:
    """Return pieces from one moment of high speed to another, without those of little motion."""
    begins: list[int] = []
    sampled, fast = motion.sampled, np.abs(speed)
    end = float(sampled[-1])
    at = float(sampled[0])
    while at < end:
        low, high = np.searchsorted(sampled, [at, at + 0.5 * PIECE_S])
        if high > low:
            begins.append(int(low + np.argmax(fast[low:high])))
        at += PIECE_S
    # Around a stall torques may have reached the servo at other times than recorded.
    gaps = np.diff(sampled)
    stalls = np.flatnonzero(gaps > _STALL * np.median(gaps)) + 1
    edges = np.unique([*begins, *stalls.tolist(), sampled.size]).tolist()
    cuts = []
    for begin, after in itertools.pairwise(edges):
        moved = motion.position[begin:after]
        if after - begin >= 20 and np.ptp(moved) >= 8 * step:
            cuts.append((begin, after))
    return cuts


def _stretches(motion: Motion, speed: FloatArray, step: float) -> Iterator[tuple[int, int]]:
    """Yield stretches in one direction, without the time near a turn."""
    gaps = np.diff(motion.sampled)
    period = float(np.median(gaps))
    way = np.where(np.abs(speed) > _SLOWEST, np.sign(speed), 0.0)
    changed = (way[1:] != way[:-1]) | (gaps > _STALL * period)
    edges = [0, *(np.flatnonzero(changed) + 1).tolist(), way.size]
    turn = round(_TURN_S / period)
    for begin, after in itertools.pairwise(edges):
        first, last = begin + turn, after - turn
        if way[begin] == 0.0 or (last - first) * period < _SHORTEST_S:
            continue
        if abs(motion.position[last - 1] - motion.position[first]) < _TRAVEL * step:
            continue
        parts = max(1, round((last - first) * period / PIECE_S))
        cuts = np.linspace(first, last, parts + 1).astype(int).tolist()
        yield from itertools.pairwise(cuts)


def model_of(fit: Fit, names: Sequence[str], priors: Mapping[str, Prior] | None) -> OutputError:
    """Return the residuals of a fit's pieces, by the values of these names."""
    return OutputError(fit.pieces, fit.values, names, priors, fit.residual)


def fitted(start: Fit, priors: Mapping[str, Prior] | None = None, thorough: bool = True) -> Fit:
    """Return the fit that starts at another one, to the same pieces.

    Args:
        start: A backlash above zero is fitted too, and the values that its effects name.
        priors: Prior knowledge of values, by name.
        thorough: Iterate to convergence; else until an iteration brings little.
    """
    names = start.having().names
    return model_of(start, names, priors).fitted(start.own, thorough=thorough)
