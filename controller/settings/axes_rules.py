"""Checks the rules between the axes of a configuration, and those of their bus."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from itertools import combinations
from typing import Final

from haptic_wall.controller.settings.axes import SHARED
from haptic_wall.controller.settings.sections import Sections
from haptic_wall.controller.settings.shares import COLLECT_SHARE
from haptic_wall.hw.errors import Problem
from haptic_wall.hw.open import cycle_time, problems

BARE_INERTIA: Final = {"XM430-W350": (0.007967, 0.017927), "XL330-M288": (0.0012095, 0.0027213)}
"""Lowest and highest inertia of a bare servo, by model [kg·m²]: those of its preset"""
_HIGHEST: Final = {model: high for model, (_, high) in BARE_INERTIA.items()}
_GEARED: Final = {
    "XM430-W210": _HIGHEST["XM430-W350"] * (212.6 / 353.5) ** 2,
    "XL330-M077": _HIGHEST["XL330-M288"] * (77.5 / 288.4) ** 2,
}
"""That of the same motor behind another gear: ratios of the e-Manual"""
_UNIT: Final = 2.0
"""Largest ratio of acting and commanded torque: an identified inertia is in the latter's unit"""
_ROUNDED: Final = 1 + 1e-9
UNLIKE_ADVICE: Final = (
    "set servo.model, model.* and servo.torque_limit to those of one servo, as its preset has them"
)


def apart(config: Sections) -> Iterator[Problem]:
    """Yield the settings of the bus in which an axis differs."""
    for name, axis in config.axes.items():
        for field in SHARED:
            found, wanted = getattr(axis.servo, field), getattr(config.servo, field)
            if found != wanted:
                yield Problem(
                    f"found {found}",
                    wanted=f"{wanted}, as servo.{field}: all axes share one bus",
                    advice=f"set servo.{field} at the top level only",
                    field=f"axes.{name}.servo.{field}",
                )


def broken_bus_rules(config: Sections) -> Iterator[Problem]:
    """Yield the violations of the rules of a bus and its axes."""
    asked = [replace(one.servo.asked(), read=config.bus.read) for one in config.each.values()]
    yield from problems(asked)
    if config.servo.baud is not None:
        yield from _cycle(config, cycle_time(asked))
    yield from _arm(config)
    if not config.axes:
        return
    if config.servo.kind != "simulated":
        for (one, first), (other, second) in combinations(config.axes.items(), 2):
            if first.servo.id == second.servo.id:
                yield Problem(
                    f"found {second.servo.id}, which is also that of axes.{one}",
                    wanted="an id that no other servo of the bus has",
                    field=f"axes.{other}.servo.id",
                )
    if len(config.axes) > 1:
        yield from _bare(config)
        yield from _of_another(config)


def _cycle(config: Sections, cycle: float) -> Iterator[Problem]:
    """A cycle on the wire [s] must fit the period."""
    period, count = config.period_s, len(config.each)
    if cycle > COLLECT_SHARE * period:
        several = f" with {count} servos" if count > 1 else ""
        yield Problem(
            f"found {config.servo.baud}, at which a cycle{several} takes {1e3 * cycle:.3g} ms on"
            f" the wire, more than {COLLECT_SHARE:g} of a period of {1e3 * period:.3g} ms",
            field="servo.baud",
            advice="use a faster bus (set the servo's rate first) or loop.rate_hz below "
            f"{COLLECT_SHARE / cycle:.3g}",
        )


def _bare(config: Sections) -> Iterator[Problem]:
    """The guard needs the servo's own inertia: that of links changes with the pose."""
    for name, axis in config.axes.items():
        believed = axis.model.inertia
        bare = (_HIGHEST | _GEARED).get(axis.servo.model or "")
        if believed is None or bare is None:
            continue
        if believed.low > bare * _ROUNDED:
            yield Problem(
                f"found {believed.low:g} kg·m² as its low bound",
                wanted=f"at most {bare:.5g}, that of a bare {axis.servo.model}: an inertia "
                "identified on an assembled arm holds in one pose only, and in others the wall is "
                "unstable",
                advice="identify the servo without its links, or take the preset's bounds",
                field=f"axes.{name}.model.inertia",
            )


def unlike_model(config: Sections) -> str:
    """Say why a belief cannot be that of a real ``servo.model``; empty: it can.

    Nothing that it turns makes a servo lighter.
    """
    model, believed = config.servo.model, config.model.inertia
    bare = BARE_INERTIA.get(model or "")
    if config.servo.kind != "hardware" or believed is None or bare is None:
        return ""
    least = bare[0] / _UNIT
    if believed.high >= least:
        return ""
    return (
        f"model.inertia is at most {believed.high:.3g} kg·m², but a bare {model} has at least "
        f"{least:.3g}"
    )


def _of_another(config: Sections) -> Iterator[Problem]:
    """Another gear has another inertia: with that of a heavier servo a wall would be unstable."""
    seen: dict[float, tuple[str, str | None]] = {}
    if config.model.inertia is not None and config.servo.model is not None:
        seen[config.model.inertia.low] = ("servo.model", config.servo.model)
    for name, axis in config.axes.items():
        believed, model = axis.model.inertia, axis.servo.model
        if believed is not None:  # of any law: a running wall takes another law
            other, of = seen.setdefault(believed.low, (f"axes.{name}", model))
            if of != model:
                yield Problem(
                    f"found that of {other}, a bare {of}",
                    wanted=f"that of a bare {model}",
                    advice=f"set what axes.{name} has of its own of model.*",
                    field=f"axes.{name}.model.inertia",
                )


def _arm(config: Sections) -> Iterator[Problem]:
    if config.arm.shape == "none":
        return
    found = f"found {config.arm.shape}"
    if config.servo.kind == "hardware":
        wanted = f"none: the servo at {config.servo.port} is real"
        yield Problem(found, wanted=wanted, field="arm.shape")
    elif len(config.axes) < 2:
        yield Problem(found, wanted="two axes or more", field="arm.shape")
    for name, axis in list(config.axes.items())[:2]:
        if axis.servo.load_inertia:
            wanted = "0: the links of an arm are rigid"
            field = f"axes.{name}.servo.load_inertia"
            yield Problem(f"found {axis.servo.load_inertia:g}", wanted=wanted, field=field)
