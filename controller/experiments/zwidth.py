"""The Z-width of a servo: its largest stiffness over the virtual damping, by velocity estimates.

By exact theory for the servo in the middle of the belief, and by the guard, which uses the belief's
least safe corner and its margin. A sweep measures points of it.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass, field
from typing import Any, Literal

import numpy as np

from haptic_wall.controller.errors import ConfigError
from haptic_wall.controller.experiments.commission.verdict import GuardQuestion
from haptic_wall.controller.experiments.holding import sample_age, without_hand
from haptic_wall.controller.experiments.sweep.device import Device
from haptic_wall.controller.guard.limits import evaluate, least_of
from haptic_wall.controller.laws.wall import Side
from haptic_wall.controller.settings.config import Config
from haptic_wall.controller.settings.load import loaded
from haptic_wall.controller.system.json_text import plain
from haptic_wall.controller.theory.checks import FloatArray

_LEAST, _MOST = 1e-4, 0.98
"""Fractions of the ceiling from which and up to which limits are computed, beside none"""
_POINTS = 80
_LOWPASS_OF_RATE = 0.1
"""Corner of the usual low-pass, over the rate"""
_Q = 0.7
_SAMPLES = (1, 2, 4)

FilterKind = Literal["none", "lowpass", "notch"]


@dataclass(frozen=True, slots=True)
class Velocity:
    """An estimate of the velocity that damps."""

    samples: int
    """N of the difference"""
    filter: FilterKind = "none"
    hz: float | None = None
    """Corner of the low-pass, or middle of the notch [Hz]"""
    q: float | None = None

    @property
    def label(self) -> str:
        """Return a few words for tables and legends."""
        filtered = "" if self.filter == "none" else f", {self.filter} {self.hz:g} Hz q {self.q:g}"
        return f"N {self.samples}{filtered}"


@dataclass(frozen=True, slots=True)
class Width:
    """Stiffness over virtual damping with one estimate of the velocity."""

    velocity: Velocity
    reason: str | None = None
    """Why a configuration with this estimate is refused; None: it is not"""
    virtual_damping: FloatArray = field(default_factory=lambda: np.empty(0))
    """[N·m·s/rad]"""
    exact: FloatArray = field(default_factory=lambda: np.empty(0))
    """Two-sided, for the middle of the belief [N·m/rad]"""
    guard: FloatArray = field(default_factory=lambda: np.empty(0))
    """Commanded; NaN above the damping that is commanded [N·m/rad]"""
    side: Side = "both"
    """Side of that wall: CONFIG's, but with a filter both, because such a wall is two-sided"""
    ceiling: float = math.nan
    """Of the exact theory [N·m·s/rad]"""
    delay_s: float = math.nan
    """Total, believed"""

    def report(self) -> dict[str, Any]:
        """Return JSON-ready values."""
        curves = {"exact": self.exact, "guard": self.guard}
        return {
            "velocity": asdict(self.velocity),
            "label": self.velocity.label,
            "reason": self.reason,
            "side": self.side,
            "delay_s": plain(self.delay_s),
            "max_virtual_damping": plain(self.ceiling),
            "peak": {name: self.peak(curve) for name, curve in curves.items()},
            "curve": [
                {"virtual_damping": float(damping)}
                | {name: plain(curve[i]) for name, curve in curves.items()}
                for i, damping in enumerate(self.virtual_damping)
            ],
        }

    def peak(self, curve: FloatArray) -> dict[str, float] | None:
        """Return the highest stiffness of a curve with its damping; None: it has none."""
        if not np.isfinite(curve).any():
            return None
        best = int(np.nanargmax(curve))
        return {
            "stiffness": float(curve[best]),
            "virtual_damping": float(self.virtual_damping[best]),
        }


def velocities(config: Config, samples: Sequence[int] | None) -> tuple[Velocity, ...]:
    """Return the estimates to compare, CONFIG's own first.

    Args:
        config: With N and perhaps a filter.
        samples: N of the unfiltered ones; None: 1, 2 and 4.
    """
    wall, rate = config.wall, config.loop.rate_hz
    found = []
    if wall.velocity_filter != "none":
        own = (wall.velocity_filter, wall.velocity_hz, wall.velocity_q)
        found.append(Velocity(wall.velocity_samples, *own))
    own_samples = [wall.velocity_samples] if samples is None else []
    found += [Velocity(n) for n in (*own_samples, *(samples or _SAMPLES))]
    if wall.velocity_filter == "none":
        n = wall.velocity_samples
        found.append(Velocity(n, "lowpass", _LOWPASS_OF_RATE * rate, _Q))
        belief = config.belief()
        if belief.is_flexible and not belief.is_fast(config.period_s):
            found.append(Velocity(n, "notch", float(f"{belief.flexible_hz.value:.3g}"), _Q))
    return tuple(dict.fromkeys(found))


def width_of(config: Config, velocity: Velocity) -> Width:
    """Return theory and guard for one estimate of the velocity.

    Args:
        config: The effective configuration.
        velocity: The estimate.
    """
    try:
        two_sided = _with(config, velocity, side="both")
    except ConfigError as error:
        return Width(velocity, str(error.problem))
    device = Device.of(two_sided)
    delay = device.lag + two_sided.delay.steps * device.period + sample_age(two_sided)
    ceiling = device.loop.ceiling(delay)
    # Denser at small dampings: the encoder allows most servos a small part of the ceiling.
    dampings = np.concatenate([[0.0], ceiling * np.geomspace(_LEAST, _MOST, _POINTS)])
    side: Side = config.wall.side if velocity.filter == "none" else "both"
    return Width(
        velocity,
        virtual_damping=dampings,
        exact=np.asarray(device.loop.critical(dampings, delay).stiffness),
        guard=_guarded(_with(config, velocity, side), dampings),
        side=side,
        ceiling=ceiling,
        delay_s=delay,
    )


def _with(config: Config, velocity: Velocity, side: Side) -> Config:
    raw: dict[str, Any] = without_hand(config).model_dump(mode="json")
    raw["wall"] |= {
        "side": side,
        "velocity_samples": velocity.samples,
        "velocity_filter": velocity.filter,
    }
    if velocity.filter != "none":
        raw["wall"] |= {"velocity_hz": velocity.hz, "velocity_q": velocity.q}
    return loaded(raw, velocity.label)


def _guarded(config: Config, dampings: FloatArray) -> FloatArray:
    """Return the stiffness that the guard commands at each damping; NaN where it lowers that."""
    question = GuardQuestion.of(config, None)
    walls = question.walls(dampings)
    commanded = question.settings.margin * least_of(evaluate(walls))
    return np.where(walls.damping < dampings * (1.0 - 1e-9), np.nan, commanded)


def text(found: Sequence[Width]) -> list[str]:
    """Return a table of the peaks."""
    return [
        "largest stiffness K [N·m/rad], and the virtual damping B [N·m·s/rad] there",
        f"{'velocity':<26}{'ceiling B':>10}{'exact K':>10}{'at B':>9}{'guard K':>10}{'at B':>9}",
        *map(_width_line, found),
    ]


def _width_line(width: Width) -> str:
    if width.reason is not None:
        return f"{width.velocity.label:<26}{width.reason}"
    cells = f"{width.ceiling:>10.4g}"
    for peak in (width.peak(width.exact), width.peak(width.guard)):
        cells += (
            f"{'-':>10}{'-':>9}"
            if peak is None
            else f"{peak['stiffness']:>10.4g}{peak['virtual_damping']:>9.3g}"
        )
    return f"{width.velocity.label:<26}{cells}" + ("  two-sided" if width.side == "both" else "")
