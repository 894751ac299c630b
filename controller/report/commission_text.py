"""Formats a commissioning's report: stiffness and why, agreement, what is unknown, next steps.

docs/how-to/commissioning.md explains what holds for every servo.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from typing import Any

from haptic_wall.controller.experiments.commission.sequence import (
    INCOMPLETE,
    NOT_MEASURED,
    check_text,
)
from haptic_wall.controller.guard.limits import BY_NAME

Report = Mapping[str, Any]


def headline(report: Report) -> str:
    """Return the answer: the stiffness."""
    verdict = report["verdict"]
    best, plain = verdict["best"]["commanded"], verdict["plain"]["commanded"]
    can = "can hold"
    if report["status"] == NOT_MEASURED:
        can = "was not identified; by the belief of its configuration it can hold"
    start = f"{report['name']} {can} a wall of {_n(best['stiffness'])} N·m/rad"
    if report["status"] == INCOMPLETE:
        missing = [
            f"the rest of {step['step']}" if report[step["step"]] else step["step"]
            for step in report["steps"]
            if step["state"] != "done" and step["step"] != "doctor"
        ]
        start = f"INCOMPLETE, without {', '.join(missing)}: {start}"
    elif report["status"] == NOT_MEASURED:
        start = f"NOT MEASURED: {start}"
    if best["damping"] == 0.0:
        return f"{start}; virtual damping does not help it."
    return (
        f"{start} with a virtual damping of {_n(best['damping'])} N·m·s/rad, and of"
        f" {_n(plain['stiffness'])} without."
    )


def why(report: Report) -> Iterator[str]:
    """Yield the limits that bind the stiffness, and what would raise it."""
    verdict = report["verdict"]
    best = verdict["best"]["commanded"]
    yield from _bound("without virtual damping", verdict["plain"])
    if best["damping"] != 0.0:
        yield from _bound("with the best virtual damping", verdict["best"])
    # The first one is of the binding limit and the request, which is above every limit.
    yield from verdict["best"]["reasons"][1:]
    if best["stiffness"] > 0.0:
        depth = verdict["torque_limit"] / best["stiffness"]
        yield (
            f"at {_n(best['stiffness'])} N·m/rad the torque limit of"
            f" {_n(verdict['torque_limit'])} N·m is reached {_n(depth)} rad"
            f" ({_n(math.degrees(depth))}°) inside the wall"
        )


def _bound(which: str, decided: Mapping[str, Any]) -> Iterator[str]:
    binding = decided["binding"]
    if binding is not None:
        yield (
            f"{which}: {decided['margin']:g} of the limit {binding},"
            f" {_n(decided['limit'][binding])} N·m/rad ({BY_NAME[binding].meaning})"
        )


def agrees(report: Report) -> Iterator[str]:
    """Yield how many measured points agree with the model, and the margin that the others need."""
    points = report["agreement"]["boundary"] or ()
    measured = [point for point in points if point["measured"] is not None]
    if not measured:
        yield "no point of the boundary was measured"
        return
    off = [point for point in measured if not point["agree"]]
    low = [point for point in off if point["measured"] < point["expected"]]
    yield f"{len(measured) - len(off)} of {len(measured)} measured points agree with the model"
    if low:
        early = min(point["measured"] / point["expected"] for point in low)
        margin = report["verdict"]["margin"] * min(p["measured"] / p["low"] for p in low)
        yield (
            f"{len(low)} below it, from {early:.2f} of the expected stiffness on: until the cause"
            f" is found, set guard.margin to {margin:.2g}"
        )
    if len(off) > len(low):
        yield f"{len(off) - len(low)} above it, on the safe side"


def unknown(report: Report) -> Iterator[str]:
    """Yield the warnings of identify, and the points without a figure."""
    yield from (report["identify"] or {}).get("warnings", ())
    for point in report["agreement"]["boundary"] or ():
        if point["measured"] is None:
            yield (
                f"no figure at virtual damping {point['virtual_damping']:g} and"
                f" {point['delay_steps']} periods inserted: {point['reason']}"
            )


def wrong(report: Report) -> Iterator[str]:
    """Yield the doctor's faults, and their remedies."""
    checks = (report["doctor"] or {}).get("checks", ())
    yield from (check_text(check) for check in checks if not check["ok"])


def following(report: Report) -> Iterator[tuple[str, str]]:
    """Yield the next steps: a command, and its purpose."""
    config = report["config"]
    if config is None:
        return
    best = report["verdict"]["best"]["commanded"]
    # Rounded down, so that the guard commands the requested value.
    stiffness = math.floor(best["stiffness"] * 10.0) / 10.0
    yield f"haptic-wall run {config}", "the wall of your configuration, with the identified model"
    if stiffness > 0.0:
        yield (
            f"haptic-wall run {config} --set wall.stiffness={stiffness:g}"
            f" --set wall.damping={best['damping']:g}",
            "the stiffest wall",
        )


def _n(value: float) -> str:
    """Format three digits, without an exponent where that is short."""
    return f"{float(f'{value:.3g}'):g}"
