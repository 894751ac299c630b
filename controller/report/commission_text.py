"""Formats a commissioning's report in words: stiffness and why, agreement, unknowns, next steps."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from haptic_wall.controller.experiments.commission.sequence import (
    INCOMPLETE,
    NOT_MEASURED,
    check_text,
)

Report = Mapping[str, Any]

_ENDS = {"failed": "tried and failed", "skipped": "left out", "interrupted": "interrupted"}


def headline(report: Report) -> str:
    """Return the answer: the stiffness, and what friction adds to it."""
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
        f" {_n(plain['stiffness'])} without.{_with_friction(report)}"
    )


def _with_friction(report: Report) -> str:
    """Return what the sweep measured without virtual damping, where friction added to it."""
    points = [p for p in report["agreement"]["boundary"] or () if p["virtual_damping"] == 0.0]
    first = min(points, key=lambda p: float(p["delay_steps"]), default=None)
    if first is None or (first["measured"] or 0.0) <= first["without_friction"]:
        return ""
    return (
        f" Without it the sweep measured {_n(first['measured'])} with friction, which stopped a"
        f" kick of {_n(first['kick_rad'])} rad; the guard does not count on friction, which does"
        " not stop a larger one."
    )


def why(report: Report) -> Iterator[str]:
    """Yield what limits the stiffness, and what would raise it."""
    verdict = report["verdict"]
    if verdict["basis"] == "believed":
        yield (
            "These values follow from the belief in the configuration: the servo was not"
            " identified, so none of them is measured."
        )
    for which, case in (
        ("Without virtual damping", "plain"),
        ("With the best virtual damping", "best"),
    ):
        decided = verdict[case]
        if case == "best" and decided["commanded"]["damping"] == 0.0:
            continue
        # the verdict asks for more than any limit allows: that figure tells nothing
        asked = f" instead of {decided['requested']['stiffness']:.4g} N"
        # and the best virtual damping stands below
        reasons = [each for each in decided["reasons"] if not each.startswith("with virtual damp")]
        yield f"{which} {'; '.join(reasons).replace(asked, ' N')}."
    stiffness = verdict["best"]["commanded"]["stiffness"]
    if stiffness > 0.0:
        depth = verdict["torque_limit"] / stiffness
        yield (
            f"At {_n(stiffness)} N·m/rad the torque limit of {_n(verdict['torque_limit'])} N·m is"
            f" reached {_n(depth)} rad ({_n(math.degrees(depth))}°) inside the wall."
        )


def agrees(report: Report) -> Iterator[str]:
    """Yield whether theory and measurements agree."""
    found = report["agreement"]
    if found["boundary"] is not None:
        yield from _boundary(found["boundary"], report["verdict"]["margin"])
    else:
        yield "The boundary was not measured, so it could not be compared."


def _boundary(points: Sequence[Mapping[str, Any]], margin: float) -> Iterator[str]:
    measured = [point for point in points if point["measured"] is not None]
    if not measured:
        yield "No point of the boundary could be measured; “What is not known” has the reasons."
        return
    agreeing = [point for point in measured if point["agree"]]
    yield (
        f"{len(agreeing)} of {len(measured)} measured points of the stability boundary agree with"
        " the model, friction and kick included (within the model's bounds, at least 5 %, and two"
        " standard errors)."
    )
    low = [p for p in measured if not p["agree"] and _below(p)]
    high = [p for p in measured if not p["agree"] and not _below(p)]
    if low:
        early = min(p["measured"] / p["expected"] for p in low)
        worst = min(p["measured"] / p["low"] for p in low)
        yield (
            f"At other points the servo oscillates from {early:.2f} of the expected stiffness on:"
            " an effect that the model does not know reduces the stability (an elastic coupling, a"
            " longer delay, more backlash). This stiffness is"
            f" {worst:.2f} of the least one within the bounds; until the cause is found, set"
            f" guard.margin to {margin * worst:.2g}."
        )
    if high:
        yield (
            "At points that lie above the expected stiffness the servo has more friction or less"
            " delay than identified; there the guard is on the safe side."
        )
    if not low:
        yield "No measured point requires a lower guard.margin than the configured one."


def _below(point: Mapping[str, Any]) -> bool:
    return bool(point["measured"] < point["expected"])


def unknown(report: Report) -> Iterator[str]:
    """Yield what remains unknown after the commissioning."""
    identify = report["identify"]
    if identify is not None:
        unit = (
            "the measured current times the torque constant"
            if identify["torque_unit"] == "measured"
            else "the commanded torque"
        )
        yield (
            f"The unit of all torques is that of {unit}: N·m is only as accurate as the torque"
            " constant (published ones of one model differ by a third). Stiffness, damping, inertia"
            " and friction have the same relative error, so it does not change the stability; for"
            " true N·m hang a known weight on a known lever."
        )
        yield from (f"{warning[:1].upper()}{warning[1:]}." for warning in identify["warnings"])
        if identify["backlash"] is None:
            said = "No backlash between motor and shaft was found; a little may exist"
            if report["verdict"]["best"]["binding"] == "backlash":
                said += (
                    ", and the configuration keeps its model.backlash, which limits the stiffness:"
                    " measure yours, as with a dial gauge on a lever of the shaft with the motor"
                    " held, and set model.backlash if it is less"
                )
            yield f"{said}."
    for step in report["steps"]:
        if step["state"] in _ENDS and step["step"] != "doctor":
            reason = f": {step['reason']}" if step["reason"] else ""
            yield f"The step {step['step']} was {_ENDS[step['state']]}{reason}."
        elif step["state"] == "not taken":
            yield f"The step {step['step']} was not reached."
    for point in report["agreement"]["boundary"] or ():
        if point["measured"] is None:
            yield (
                f"There is no figure at virtual damping {point['virtual_damping']:g} and"
                f" {point['delay_steps']} periods inserted: {point['reason']}."
            )
    friction = report["verdict"]["model"]["coulomb"]["value"]
    if friction > 0.0:
        yield (
            f"Coulomb friction ({_n(friction)} N·m) lets small motion die even above the limits,"
            " which are those without friction. The guard does not count on it: it varies with the"
            " position, and does not stop a larger motion."
        )
    if identify is None:
        return
    yield (
        "The servo was measured free, at one temperature and on one day: a part that is mounted"
        " later changes the inertia; wear and temperature change the friction. The bounds in the"
        " configuration cover a small change; after a larger one, commission the servo again."
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
