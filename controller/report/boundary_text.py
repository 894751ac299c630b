"""Formats the answer of ``haptic-wall boundary``: points, peak, and the stiffest wall."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from haptic_wall.controller.guard.limits import BY_NAME


def boundary_text(found: Mapping[str, Any]) -> str:
    """Format the answer as text.

    Args:
        found: The answer, as for ``--json``.
    """
    return "\n".join([*_points(found), "", *_stiffest(found)])


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
    of = "exact" if points[0]["flexible"] is None else "flexible"
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


def _aligned(rows: Sequence[Sequence[str]]) -> Iterator[str]:
    """Align columns, numbers to the right."""
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    for row in rows:
        cells = (cell.rjust(width) for cell, width in zip(row, widths, strict=True))
        yield "  ".join(cells).rstrip()


def _name(limit: str) -> str:
    return limit.replace("_", "-")
