"""Formats a commissioning's report in words: stiffness and why, agreement, unknowns, next steps."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from haptic_wall.controller.experiments.commission.report import INCOMPLETE, NOT_MEASURED
from haptic_wall.controller.experiments.identify.text import UNITS
from haptic_wall.controller.guard.delay_parts import ms

Report = Mapping[str, Any]

_CLOSE = 1.05
"""Limits within this factor of the smallest are reported together"""
_PARTS = {
    "hold": "half the period",
    "sample_age": "age of the sample",
    "inserted": "inserted",
    "device": "the device's own, at its longest",
}
_NAMES = {"coulomb": "Coulomb friction", "torque_gain": "torque gain"}
_ENDS = {"failed": "tried and failed", "skipped": "left out"}
_NEAR_ONE = 0.02
"""Largest deviation of rendered over commanded stiffness from one without a warning"""


def headline(report: Report) -> str:
    """Return the answer in one sentence."""
    verdict = report["verdict"]
    best, plain = verdict["best"]["commanded"], verdict["plain"]["commanded"]
    can = "can hold"
    if report["status"] == NOT_MEASURED:
        can = "was not identified; by the belief of its configuration alone it would hold"
    start = f"{report['name']} {can} a wall of {_n(best['stiffness'])} N·m/rad"
    if report["status"] == INCOMPLETE:
        missing = [
            step["step"]
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
    """Yield what limits the stiffness, and what would raise it."""
    verdict = report["verdict"]
    if verdict["basis"] == "believed":
        yield (
            "This is what the model in the configuration says: the servo was not identified, so"
            " nothing of it is measured."
        )
    for which, case in (("Without virtual damping", "plain"), ("With the best of it", "best")):
        decided = verdict[case]
        if case == "best" and decided["commanded"]["damping"] == 0.0:
            continue
        yield f"{which} {'; '.join(decided['reasons'])}."
    yield from _together(verdict["best"])
    parts = ", ".join(
        f"{_PARTS[part['name']]} {ms(part['seconds'])} ({100 * part['share']:.0f} %)"
        for part in verdict["delay_parts"]
        if part["seconds"] > 0.0
    )
    yield f"The delay that the damping is divided by is made of: {parts}."
    stiffness = verdict["best"]["commanded"]["stiffness"]
    if stiffness > 0.0:
        depth = verdict["torque_limit"] / stiffness
        yield (
            f"At {_n(stiffness)} N·m/rad the torque limit of {_n(verdict['torque_limit'])} N·m is"
            f" reached {_n(depth)} rad ({_n(math.degrees(depth))}°) inside the wall."
        )
    yield from _configured(verdict["configured"])


def _together(best: Mapping[str, Any]) -> Iterator[str]:
    limits = {name: value for name, value in best["limit"].items() if value is not None}
    least = min(limits.values())
    near = [f"{name} {_n(value)}" for name, value in limits.items() if value <= _CLOSE * least]
    if len(near) > 1 and least > 0.0:
        yield (
            f"At that damping the limits {', '.join(near)} lie together: raising one of them alone"
            " buys next to nothing."
        )


def _configured(decided: Mapping[str, Any]) -> Iterator[str]:
    asked, given = decided["requested"], decided["commanded"]
    wall = f"{_n(asked['stiffness'])} N·m/rad, {_n(asked['damping'])} N·m·s/rad"
    if asked == given:
        yield f"The wall of this configuration ({wall}) is commanded as it is."
    else:
        yield f"Of the wall of this configuration ({wall}): {'; '.join(decided['reasons'])}."


def agrees(report: Report) -> Iterator[str]:
    """Yield whether theory and measurements agree."""
    found = report["agreement"]
    if found["delay"] is not None:
        yield from _delay(found["delay"])
    if report["rendered"] is not None:
        yield from _rendered(report["rendered"])
        if report["identify"] is not None and report["identify"]["warnings"]:
            yield (
                "A weight, cogging or friction at rest of the servo itself is part of what is"
                " rendered: see what is not known."
            )
    if found["boundary"] is not None:
        yield from _boundary(found["boundary"], report["verdict"]["margin"])
    if found["line"] is not None:
        yield from _line(found["line"])
    if all(value is None for value in found.values()):
        yield "Nothing was measured twice, so nothing could be compared."


def _delay(found: Mapping[str, Any]) -> Iterator[str]:
    device = found["device"]
    one, other = device["identify"], device["delay"]
    said = (
        f"The device's own delay is {_pm_ms(one)} by its motions, {_pm_ms(other)} by torque steps:"
    )
    if device["agree"]:
        yield f"{said} the two agree within two standard errors."
    else:
        longest = max(each["value"] + 2.0 * each["stderr"] for each in (one, other))
        yield (
            f"{said} the two do NOT agree (apart by {device['periods']:.2g} periods). Until it is"
            f" known why, set model.delay so that its high is {longest:.3g} s."
        )
    for point in found["inserted"]["points"]:
        end = "as it should be" if point["agree"] else "which is NOT what was inserted"
        yield (
            f"{ms(point['inserted'])} inserted on purpose came out as"
            f" {_pm_ms(point['recovered'])}, {end}."
        )


def _rendered(found: Mapping[str, Any]) -> Iterator[str]:
    rows = {row["name"]: row for row in found["rows"]}
    for name in ("static stiffness", "static stiffness, true"):
        row = rows.get(name)
        if row is None or row["rendered"] is None:
            continue
        ratio = row["ratio"]
        off = ratio is not None and abs(ratio - 1.0) > _NEAR_ONE
        if name != "static stiffness" and not off:
            continue
        said = (
            f"{name.capitalize()}: {_n(row['commanded'])} N·m/rad commanded,"
            f" {_n(row['rendered'])}{_pm(row['stderr'])} rendered, {row['note']}"
        )
        yield f"{said}: {ratio:.3f} of it." if off else f"{said}."


def _boundary(points: Sequence[Mapping[str, Any]], margin: float) -> Iterator[str]:
    measured = [point for point in points if point["measured"] is not None]
    if not measured:
        yield "No point of the boundary could be measured; the reasons stand with the points."
        return
    agreeing = [point for point in measured if point["agree"]]
    yield (
        f"{len(agreeing)} of {len(measured)} measured points of the stability boundary lie where"
        " the model expects them (friction and kick counted; within the model's bounds, at least"
        " 5 %, and two standard errors)."
    )
    low = [p for p in measured if not p["agree"] and _below(p)]
    high = [p for p in measured if not p["agree"] and not _below(p)]
    if low:
        early = min(p["measured"] / p["expected"] for p in low)
        worst = min(p["measured"] / p["low"] for p in low)
        yield (
            f"Where they do not, the servo oscillates from {early:.2f} of the expected stiffness"
            " on: something takes stability away that the model does not know (an elastic coupling,"
            " a longer delay, more backlash). That is"
            f" {worst:.2f} of what the bounds allow for; until it is found, set guard.margin to"
            f" {margin * worst:.2g}."
        )
    if high:
        yield (
            "Where measured points lie higher than expected, the servo has more friction than was"
            " identified, or less delay; the guard is on the safe side there."
        )
    if not low:
        yield "No measured point asks for less than the configured guard.margin."
    bounded = [p["kick_rad"] for p in measured if p["larger_grows"] is False]
    if bounded:
        yield (
            f"At {len(bounded)} of the points larger motion dies: the servo swings by about"
            f" {_n(1e3 * max(bounded))} mrad there, and does not grow further."
        )


def _below(point: Mapping[str, Any]) -> bool:
    return bool(point["measured"] < point["expected"])


def _line(found: Mapping[str, Any]) -> Iterator[str]:
    if "reason" in found:
        yield f"Damping and delay could not be read off the boundary: {found['reason']}."
        return
    damping, compared = found["damping"], found["compared"]
    said = [
        f"{name} {'agrees' if compared[name]['agree'] else 'does NOT agree'}"
        for name in ("damping", "delay")
    ]
    yield (
        f"Read off the measured boundary, the damping is {_n(damping['value'])} ±"
        f" {damping['stderr']:.2g} N·m·s/rad and the delay {_pm_ms(found['delay'])}; beside what"
        f" the motions say, {said[0]} and {said[1]}."
    )


def unknown(report: Report) -> Iterator[str]:
    """Yield what remains unknown after the commissioning."""
    identify = report["identify"]
    if identify is not None:
        unit = (
            "its current, by the torque constant"
            if identify["torque_unit"] == "measured"
            else "the torque commanded"
        )
        yield (
            f"All torques are in the unit of {unit}: N·m is only as good as the torque constant"
            " (published ones of one model differ by a third). Stiffness, damping, inertia and"
            " friction are wrong by the same share, so stability is not touched; for true N·m hang"
            " a known weight on a known lever."
        )
        yield from (f"{warning[:1].upper()}{warning[1:]}." for warning in identify["warnings"])
        if identify["backlash"] is None:
            yield "Backlash between motor and shaft was not seen; a little may be there."
    for step in report["steps"]:
        if step["state"] in ("failed", "skipped") and step["step"] != "doctor":
            yield f"The step {step['step']} was {_ENDS[step['state']]}: {step['reason']}."
        elif step["state"] == "not taken":
            yield f"The step {step['step']} was not reached; the same command goes on."
    for point in report["agreement"]["boundary"] or ():
        if point["measured"] is None:
            yield (
                f"There is no figure at virtual damping {point['virtual_damping']:g} and"
                f" {point['delay_steps']} periods inserted: {point['reason']}."
            )
    friction = report["verdict"]["model"]["coulomb"]["value"]
    if friction > 0.0:
        yield (
            f"Coulomb friction ({_n(friction)} N·m) lets small motion die above the limits without"
            " friction too. The guard does not count on it: it differs from place to place, and a"
            " larger motion is not held by it."
        )
    yield (
        "It was measured free, cold or warm as it was, and on one day: whatever is mounted later"
        " changes the inertia, and wear and warmth change the friction. The bounds in the"
        " configuration allow for a little of it; after any change commission again."
    )


def wrong(report: Report) -> Iterator[str]:
    """Yield the doctor's faults, and their remedies."""
    for check in (report["doctor"] or {}).get("checks", ()):
        if not check["ok"]:
            fix = f"; {check['fix']}" if check["fix"] else ""
            yield f"{check['name']}: found {check['found']}, wanted {check['wanted']}{fix}"


def following(report: Report) -> Iterator[tuple[str, str]]:
    """Yield the next steps: a command, and its purpose."""
    config = report["config"]
    if config is None:
        return
    best = report["verdict"]["best"]["commanded"]
    # Rounded down, so that the guard commands the requested value.
    stiffness = math.floor(best["stiffness"] * 10.0) / 10.0
    yield f"haptic-wall run {config}", "the wall of your configuration, on the identified model"
    if stiffness > 0.0:
        yield (
            f"haptic-wall run {config} --set wall.stiffness={stiffness:g}"
            f" --set wall.damping={best['damping']:g}",
            "the stiffest wall",
        )


def model_rows(report: Report) -> Iterator[tuple[str, str, str, str]]:
    """Yield name, value, bounds and unit of each quantity of the model."""
    for name, each in report["verdict"]["model"].items():
        late = name == "delay"
        value, low, high = (
            f"{1e3 * each[end]:.3f}" if late else f"{each[end]:.4g}"
            for end in ("value", "low", "high")
        )
        yield _NAMES.get(name, name), value, f"{low} to {high}", "ms" if late else UNITS[name]


def _n(value: float) -> str:
    """Format three digits, without an exponent where that is short."""
    return f"{float(f'{value:.3g}'):g}"


def _pm(stderr: float | None) -> str:
    return "" if stderr is None else f" ± {stderr:.2g}"


def _pm_ms(each: Mapping[str, float]) -> str:
    return f"{1e3 * each['value']:.3f} ± {1e3 * each['stderr']:.3f} ms"
