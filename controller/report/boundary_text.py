"""Formats the answer of ``haptic-wall boundary``: points, peak, and the stiffest wall."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from haptic_wall.controller.guard.limits import BY_NAME
from haptic_wall.controller.report.run_text import filter_text
from haptic_wall.controller.system.wrapping import wrapped


def boundary_text(found: Mapping[str, Any]) -> str:
    """Format the answer as text.

    Args:
        found: The answer, as for ``--json``.
    """
    return "\n".join(
        [
            *_settings(found["settings"]),
            "",
            *_points(found),
            "",
            *_stiffest(found),
        ]
    )


def _settings(settings: Mapping[str, Any]) -> Iterator[str]:
    period = settings["period"]
    delay = settings["delay"]["high"]
    parts = [
        f"inertia {_span(settings['inertia'])} kg·m²",
        f"viscous damping {_span(settings['damping'])} N·m·s/rad",
        f"period {1e3 * period:.4g} ms ({1 / period:.4g} Hz)",
        f"delay {_span(settings['delay'], 1e3)} ms ({_periods(delay / period)})",
    ]
    if settings["torque_gain"] != {"low": 1.0, "high": 1.0}:
        parts.append(f"torque gain {_span(settings['torque_gain'])}")
    if settings["velocity_samples"] > 1:
        parts.append(f"velocity over {settings['velocity_samples']} samples")
    if filtered := settings["velocity_filter"]:
        parts.append(f"velocity through a {filter_text(filtered)}")
    if load := settings.get("load"):
        parts.append(
            f"a load of {load['inertia']:.4g} kg·m² behind {load['stiffness']:.4g} N·m/rad with"
            f" {load['damping']:.4g} N·m·s/rad, encoder on the {load['encoder']}"
        )
    if load := settings.get("believed_load"):
        parts.append(
            f"a believed load of {_span(load['inertia'])} kg·m² of it that vibrates at"
            f" {_span(load['frequency_hz'])} Hz with a damping ratio of"
            f" {_span(load['damping_ratio'])}, encoder on the {load['encoder']}"
        )
    yield from wrapped(", ".join(parts))


def _points(found: Mapping[str, Any]) -> Iterator[str]:
    points = found["points"]
    names = [name for name in BY_NAME if points[0].get(name) is not None]
    columns = ["virtual_damping", *names, "frequency_hz"]
    rows = [
        ["virtual damping", *(_name(name) for name in names), "oscillation"],
        ["N·m·s/rad", *("N·m/rad" for _ in names), "Hz"],
    ]
    rows += [[f"{point[name]:.4g}" for name in columns] for point in points]
    yield from _aligned(rows)
    yield ""
    peak = found["peak"]
    of = "flexible" if "believed_load" in found["settings"] else "exact"
    yield (
        f"ceiling  no stiffness is stable above a virtual damping of "
        f"{found['max_virtual_damping']:.4g} N·m·s/rad"
    )
    if found["encoder_damping"] is not None:
        yield (
            f"encoder  above {found['encoder_damping']:.4g} N·m·s/rad one count commands more than "
            "the guard allows"
        )
    yield (
        f"peak     {peak['stiffness']:.4g} N·m/rad ({of}) at {peak['virtual_damping']:.4g} "
        f"N·m·s/rad, oscillation at {peak['frequency_hz']:.4g} Hz"
    )


def _stiffest(found: Mapping[str, Any]) -> Iterator[str]:
    design = found["design"]
    side = "one-sided" if design["side"] == "one" else "two-sided"
    stiffest = ", the stiffest of these:" if len(found["points"]) > 1 else ":"
    yield (
        f"Limit of the {side} wall at a virtual damping of {design['virtual_damping']:.4g}"
        f"{stiffest}"
    )
    yield f"limit    {_name(design['binding'])}, {design['stiffness']:.4g} N·m/rad"
    if found["not_examined"] is not None:
        yield f"not examined: {found['not_examined']}"


def _aligned(rows: Sequence[Sequence[str]]) -> Iterator[str]:
    """Align columns, numbers to the right."""
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    for row in rows:
        cells = (cell.rjust(width) for cell, width in zip(row, widths, strict=True))
        yield "  ".join(cells).rstrip()


def _name(limit: str) -> str:
    return limit.replace("_", "-")


def _span(ends: Mapping[str, float], scale: float = 1.0) -> str:
    low, high = scale * ends["low"], scale * ends["high"]
    return f"{low:.4g}" if low == high else f"{low:.4g} to {high:.4g}"


def _periods(count: float) -> str:
    number = f"{count:.3g}"
    return f"{number} period{'' if number == '1' else 's'}"
