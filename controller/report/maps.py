"""Draws a map: stiffness over virtual damping, for some delays, the smallest and largest kick."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from haptic_wall.controller.experiments.maps.maps import CriticalMap
from haptic_wall.controller.milliseconds import ms
from haptic_wall.controller.report import style
from haptic_wall.controller.theory.checks import FloatArray

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_POINTS = 120
_MOST_DELAYS = 3
"""Largest number of drawn delays, for legibility; the table has all of them."""
_LARGE = 1e3
"""A torque limit [N·m] from here on counts as none."""


def plot_map(found: CriticalMap, name: str, path: Path) -> None:
    """Draw a map as PNG.

    Args:
        found: The map; points without a result or a limit are omitted.
        name: Name of the configuration, for the title.
        path: Path of the picture.

    Raises:
        OSError: The file cannot be written.
    """
    delays = np.unique(np.linspace(0, found.delay.size - 1, _MOST_DELAYS).round().astype(int))
    colours = dict(zip(delays.tolist(), style.shades(delays.size), strict=True))
    with style.picture(path, style.PAGE, 3.6) as figure:
        figure.suptitle(_title(found, name), fontsize=8.5, ha="left", x=0.01)
        ax = figure.subplots()
        _over_damping(ax, found, colours)
        ax.set_yscale("log")
        ax.set_ylabel(style.STIFFNESS)
        ax.set_ylim(*_range(found))
        style.grid(ax)
        figure.legend(handles=_legend(found, colours), loc="outside right upper")


def _over_damping(ax: Axes, found: CriticalMap, colours: dict[int, str]) -> None:
    setting = found.setting
    low, high = float(found.virtual_damping.min()), float(found.virtual_damping.max())
    root, square = style.ROOTS
    ends = root(np.array([low, high]))
    # Squares of roots may miss the ends by rounding.
    across = np.clip(square(np.linspace(ends[0], ends[1], _POINTS)), low, high)
    for i, colour in colours.items():
        delay = float(found.delay[i])
        most = setting.loop.ceiling(delay)
        # The curve is drawn down to zero at the ceiling.
        damping = np.unique(np.append(across, most * (1 - np.geomspace(1e-4, 0.2, 20))))
        damping = damping[(damping >= low) & (damping <= high)]
        linear, exact, one_sided = (
            each[0] for each in setting.limits(damping, np.array([delay]), tolerance=0.01)
        )
        _curve(ax, damping, linear, color=colour, linewidth=0.6, linestyle=style.DOTTED)
        _curve(ax, damping, exact, color=colour, linewidth=0.9)
        if setting.one_sided:
            _curve(ax, damping, one_sided, color=colour, linewidth=0.9, linestyle="--")
        for k, look in _shown_kicks(found).items():
            ax.plot(found.virtual_damping, _drawn(found.stiffness[i, :, k]), color=colour, **look)
    ax.set_xscale("function", functions=style.ROOTS)
    ax.locator_params(axis="x", nbins=5)
    ax.set_xlabel(f"{style.VIRTUAL_DAMPING}, square-root scale")


def _curve(ax: Axes, damping: FloatArray, stiffness: FloatArray, **look: Any) -> None:  # noqa: ANN401
    """Draw a limit over the damping; if there is only one damping, as a level line."""
    if damping.size > 1:
        ax.plot(damping, _drawn(stiffness), **look)
    elif stiffness[0] > 0.0:
        ax.axhline(stiffness[0], **look)


def _shown_kicks(found: CriticalMap) -> dict[int, dict[str, Any]]:
    """Return the smallest and the largest kick, and their markers."""
    small, large = int(np.argmin(found.kick)), int(np.argmax(found.kick))
    styles: dict[int, dict[str, Any]] = {
        small: {"marker": "o", "ms": 3.5, "mfc": "white", "mew": 0.8, "linestyle": " "}
    }
    styles[large] = {"marker": "o", "ms": 3.5, "linestyle": " "}
    return styles


def _legend(found: CriticalMap, colours: dict[int, str]) -> list[Any]:
    keys = [
        style.key(f"delay {ms(found.delay[i])}", color=colour, linewidth=2.5)
        for i, colour in colours.items()
    ]
    keys += [
        style.key(f"simulated, kick {found.kick[k]:.3g} rad", **look)
        for k, look in _shown_kicks(found).items()
    ]
    keys.append(style.key("exact, no friction", linewidth=0.9))
    if found.setting.one_sided:
        keys.append(style.key("one-sided, no friction", linewidth=0.9, linestyle="--"))
    label = "linear condition"
    return [*keys, style.key(label, color=style.GREY, linewidth=0.6, linestyle=style.DOTTED)]


def _title(found: CriticalMap, name: str) -> str:
    servo = found.setting.servo
    wall = "one-sided wall" if found.setting.one_sided else "two-sided wall"
    device = [f"$m$ {servo.inertia:.3g} kg·m²", f"$b$ {servo.damping:.3g} N·m·s/rad"]
    if servo.coulomb:
        device.append(f"Coulomb friction {servo.coulomb:.3g} N·m")
    if servo.flexible:
        device.append(
            f"load {servo.load_inertia:.3g} kg·m² on {servo.transmission_stiffness:.3g} N·m/rad"
        )
    if servo.backlash:
        device.append(f"backlash {servo.backlash:.3g} rad")
    limits = [f"{1.0 / found.setting.period:.4g} Hz"]
    if servo.counts_per_rev:
        limits.append(f"{servo.counts_per_rev} counts/rev")
    if servo.torque_limit < _LARGE:
        limits.append(f"torque limit {servo.torque_limit:.3g} N·m")
    unfinished = "" if found.complete else "   INTERRUPTED: SOME POINTS ARE NOT COMPUTED"
    return f"{style.titled(name)}: simulated critical stiffness, {wall}{unfinished}\n" + "\n".join(
        "   ".join(parts) for parts in (device, limits)
    )


def _drawn(stiffness: FloatArray) -> FloatArray:
    """Return stiffnesses that a logarithmic axis can show; NaN for the others."""
    shown: FloatArray = np.where(np.isfinite(stiffness) & (stiffness > 0.0), stiffness, np.nan)
    return shown


def _range(found: CriticalMap) -> tuple[float, float]:
    """Return the stiffness axis from below the simulated values; the exact limit goes to zero."""
    shown = found.stiffness[:, :, list(_shown_kicks(found))]
    good = shown[np.isfinite(shown) & (shown > 0.0)]
    limit = found.one_sided if found.setting.one_sided else found.exact
    first = limit[:, :1]
    values = np.concatenate([good, first[first > 0.0], [limit.max(initial=0.1)]])
    return 0.6 * float(values.min()), 1.6 * float(values.max())
