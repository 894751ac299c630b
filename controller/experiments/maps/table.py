"""Lists the points of a map: for its report, as a table, and by default."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import asdict
from typing import Any

import numpy as np

from haptic_wall.controller.experiments.maps.maps import CriticalMap
from haptic_wall.controller.experiments.maps.servo import MapSettings

_DAMPINGS = 12


def report(found: CriticalMap) -> dict[str, Any]:
    """Return the map as JSON-ready values."""
    setting = found.setting
    return {
        "side": "one" if setting.one_sided else "both",
        "period_s": setting.period,
        "velocity_samples": setting.velocity_samples,
        "servo": asdict(setting.servo),
        "complete": found.complete,
        "points": list(points(found)),
    }


def points(found: CriticalMap) -> Iterator[dict[str, Any]]:
    """Yield the points of the table and of the report."""
    for i, steps in enumerate(found.delay_steps.tolist()):
        for j, damping in enumerate(found.virtual_damping.tolist()):
            for k, kick in enumerate(found.kick.tolist()):
                value = float(found.stiffness[i, j, k])
                yield {
                    "virtual_damping": damping,
                    "delay_steps": steps,
                    "delay_s": float(found.delay[i]),
                    "kick_rad": kick,
                    "simulated": value if math.isfinite(value) else None,
                    "outcome": _outcome(value),
                    "exact": float(found.exact[i, j]),
                    "linear": float(found.linear[i, j]),
                    "one_sided": float(found.one_sided[i, j]),
                }


def _outcome(simulated: float) -> str:
    """Describe the result of the search."""
    if math.isnan(simulated):
        return "not computed"
    if math.isinf(simulated):
        return "never grows"
    return "grows above" if simulated > 0.0 else "always grows"


def default_dampings(setting: MapSettings, steps: Sequence[int]) -> list[float]:
    """Return dampings from 0 to the ceiling at the longest of some delays [N·m·s/rad].

    Args:
        setting: The servo and its loop.
        steps: Inserted delays [periods].
    """
    most = setting.loop.ceiling(float(setting.delay(np.array(max(steps)))))
    # Denser at small values, where walls are used and the limits rise steeply.
    shares = np.linspace(0.0, 1.0, _DAMPINGS) ** 2
    return [float(f"{value:.4g}") for value in shares * most]


def text(found: CriticalMap) -> list[str]:
    """Return a table of the largest kick."""
    k = int(np.argmax(found.kick))
    lines = [
        f"critical stiffness [N·m/rad], simulated, kick {found.kick[k]:g} rad",
        f"{'B [N·m·s/rad]':>14}  "
        + "".join(f"{f'{1e3 * delay:.4g} ms':>10}" for delay in found.delay),
    ]
    for j, damping in enumerate(found.virtual_damping):
        cells = "".join(f"{_cell(value):>10}" for value in found.stiffness[:, j, k].tolist())
        lines.append(f"{damping:>14.4g}  {cells}")
    return lines


def _cell(value: float) -> str:
    if math.isfinite(value):
        return f"{value:.4g}"
    return "-" if math.isnan(value) else "none"
