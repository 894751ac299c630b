"""Fits a servo's inertia, friction and delay to its motion: output error, with standard errors.

The motion is divided at moments of high speed into pieces with their own initial states, so that
unmodelled effects do not accumulate beyond a piece. The least squares start from a regression on
smoothed data, which assumes only the form of the model.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Mapping
from dataclasses import asdict, dataclass, replace
from typing import NamedTuple

import numpy as np

from haptic_wall.controller.experiments.identify.effects import NONE, Effects
from haptic_wall.controller.experiments.identify.motion import Motion, Pieces, pieces_of
from haptic_wall.controller.experiments.identify.output_error import (
    OutputError,
    Prior,
)
from haptic_wall.controller.experiments.identify.standard_errors import standard_covariance
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
_SURE = (5e-4, 5e-4, 5e-4, 0.0, 0.0)
"""Least relative uncertainty of each value: the spring's reaction contains rounding too"""
_SPEEDS = np.linspace(0.02, 1.0, 25)
"""Speeds at which friction is computed, over the largest of the motion"""
_UNQUANTISED = 1e-5
"""Largest negligible residual of a servo without an encoder step [rad]"""
_WHITE = 20.0
"""Sum of the squares of the third difference's weights"""
NAMES = ("inertia", "damping", "coulomb", "delay", "backlash")


class NoFitError(Exception):
    """The motion does not show what the model needs; the message says what is missing."""


class Friction(NamedTuple):
    """Friction of the motor at some speeds: arrays of shape (n,)."""

    speed: FloatArray
    """[rad/s]"""
    value: FloatArray
    """[N·m]"""
    stderr: FloatArray
    """[N·m]"""


@dataclass(frozen=True, slots=True)
class Fit:
    """A fitted model with its standard errors; torques in commanded units."""

    inertia: float
    """[kg·m²]"""
    damping: float
    """Mean of both directions [N·m·s/rad]"""
    coulomb: float
    """[N·m]"""
    delay: float
    """From sending a torque until it acts [s]"""
    backlash: float
    """Between shaft and encoder [rad]; 0 where none was fitted"""
    stderr: tuple[float, ...]
    """Standard errors of the five, in order; 0 for a backlash that was not fitted"""
    residual: float
    """Root mean square of measured minus fitted position [rad]"""
    pieces: Pieces
    fitted: FloatArray
    """Positions of the model [rad], shape as the pieces'"""
    speeds: FloatArray
    """At the beginning of each piece [rad/s]"""
    effects: Effects = NONE
    weaker: tuple[float, float] = (0.0, 0.0)
    """Damping in the direction where it is less, and its standard error"""
    least: float | None = None
    """Damping at least, where friction that fades with the speed may hide more [N·m·s/rad]; None:
    the standard error says how far off it may be"""
    friction: Friction | None = None
    """Over the speeds of the motion, where the sum is known better than its parts; the gear's share
    of the load comes in addition. None: not computed"""

    @property
    def noise(self) -> float:
        """Return the root mean square of the residual that changes at each sample [rad].

        It is the noise and the rounding of the readings: a motion that the model lacks is smooth.
        """
        changes = np.diff(self.fitted - self.pieces.position, 3, axis=1)[self.pieces.held[:, 3:]]
        return math.sqrt(float(np.mean(changes**2)) / _WHITE) if changes.size else 0.0

    def noise_over(self, rounding: float) -> float:
        """Return the root mean square residual of noise and rounding of the readings [rad].

        Args:
            rounding: That of rounding alone [rad].
        """
        return max(self.noise, rounding)

    def smooth_part(self, rounding: float) -> float:
        """Return the root mean square residual as if the readings had no noise but rounding [rad].

        Args:
            rounding: Root mean square of rounding [rad].
        """
        more = max(self.residual**2 - self.noise_over(rounding) ** 2, 0.0)
        return math.sqrt(more + rounding**2)


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
    speeds = np.array([speed[begin] for begin, _ in cuts])
    return replace(first_fit(motion), pieces=pieces_of(motion, cuts), speeds=speeds)


def visible_backlash(
    without: Fit, priors: Mapping[str, Prior] | None = None, *, thorough: bool = True
) -> Fit | None:
    """Return the fit with backlash; None: no backlash is visible.

    Args:
        without: The fit without.
        priors: As for it.
        thorough: As for it.
    """
    begun = replace(
        without, backlash=min(max(2.0 * without.residual, _LEAST_BACKLASH), _MOST_BACKLASH)
    )
    found = fitted(begun, priors, thorough)
    visible = found.backlash > _VISIBLE * found.stderr[4] + _LEAST_BACKLASH
    better = found.residual < without.residual and found.backlash < _MOST_BACKLASH
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


def first_fit(motion: Motion) -> Fit:
    """Return the start of the fit, by the regression of the acceleration."""
    found = start_of([motion], np.arange(0.0, _LATEST_S, 2.5e-4).tolist())
    if found["gain"] <= 0.0:
        raise NoFitError("the sent torque does not accelerate the shaft")
    inertia = 1.0 / found["gain"]
    empty = np.zeros((1, 1))
    nothing = Pieces(motion, empty, empty, empty > 0)
    # Values that cannot be distinguished at the start begin just above zero.
    return Fit(
        inertia,
        inertia * max(found["damping"], _AT_FIRST),
        inertia * max(found["coulomb"], _AT_FIRST),
        found["delay"],
        0.0,
        stderr=(),
        residual=0.0,
        pieces=nothing,
        fitted=empty,
        speeds=np.zeros(1),
    )


def model_of(fit: Fit, names: tuple[str, ...], priors: Mapping[str, Prior] | None) -> OutputError:
    """Return the residuals of a fit's pieces, by the values of these names."""
    values = {name: getattr(fit, name) for name in NAMES}
    values.update({n: v for n, v in asdict(fit.effects).items() if isinstance(v, float)})
    return OutputError(fit.pieces, values, names, priors, fit.residual)


def fitted(start: Fit, priors: Mapping[str, Prior] | None = None, thorough: bool = True) -> Fit:
    """Return the fit that starts at another one, to the same pieces.

    Args:
        start: A backlash above zero is fitted too, and the values that its effects name.
        priors: Prior knowledge of values, by name.
        thorough: Iterate to convergence; else until an iteration brings little.
    """
    count = 5 if start.backlash > 0.0 else 4
    names = (*NAMES[:count], *start.effects.fitted)
    model = model_of(start, names, priors)
    values, speeds = model.fitted(start.speeds[None], thorough=thorough)
    return made(start, model, values, speeds[0])


def made(start: Fit, model: OutputError, values: FloatArray, speeds: FloatArray) -> Fit:
    """Return the fit with these values, and its standard errors."""
    linear = model.linear(values, speeds[None])
    left = linear.left[start.pieces.held]
    period = float(np.median(np.diff(start.pieces.motion.sampled)))
    every = dict(zip(model.names, values.tolist(), strict=True))
    covariance = standard_covariance(linear, period)
    errors = dict(zip(model.names, np.sqrt(np.diag(covariance)).tolist(), strict=True))
    shares = dict(zip(NAMES, _SURE, strict=True))
    stderr = tuple(
        float(np.hypot(errors.get(name, 0.0), shares[name] * every.get(name, 0.0)))
        for name in NAMES
    )
    effects = replace(
        start.effects,
        **{name: every[name] for name in start.effects.fitted},
        errors={name: errors[name] for name in start.effects.fitted},
    )
    return Fit(
        every["inertia"],
        every["damping"],
        every["coulomb"],
        every["delay"],
        every.get("backlash", 0.0),
        stderr=stderr,
        residual=float(np.sqrt(np.mean(left**2))),
        pieces=start.pieces,
        fitted=start.pieces.position + linear.left,
        speeds=speeds,
        effects=effects,
        weaker=_weaker(model.names, every, covariance, stderr[1]),
        friction=_friction(model.names, every, covariance, _SPEEDS * float(np.abs(speeds).max())),
    )


def _friction(
    names: tuple[str, ...], values: Mapping[str, float], covariance: FloatArray, speed: FloatArray
) -> Friction:
    """Return the friction at some speeds, both directions' mean."""
    slopes = {"coulomb": np.ones_like(speed), "damping": speed, "drag": speed**2}
    if "excess" in names:
        slopes["excess"] = np.exp(-speed / values["fading"])
        slopes["fading"] = values["excess"] * slopes["excess"] * speed / values["fading"] ** 2
    rows = np.array([slopes.get(name, np.zeros_like(speed)) for name in names])
    value = sum(values[n] * slopes[n] for n in slopes if n in names and n != "fading")
    stderr = np.sqrt(np.maximum(np.einsum("iv,ij,jv->v", rows, covariance, rows), 0.0))
    return Friction(speed, np.asarray(value), stderr)


def _weaker(
    names: tuple[str, ...], values: Mapping[str, float], covariance: FloatArray, stderr: float
) -> tuple[float, float]:
    """Return the damping in the direction where it is less, and its standard error."""
    if "uneven" not in names:
        return values["damping"], stderr
    one, other = names.index("damping"), names.index("uneven")
    sign = -1.0 if values["uneven"] > 0.0 else 1.0
    variance = covariance[one, one] + covariance[other, other]
    variance += 2.0 * sign * covariance[one, other]
    return values["damping"] - abs(values["uneven"]), float(np.sqrt(max(variance, 0.0)))
