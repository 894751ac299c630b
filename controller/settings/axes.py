"""Several axes on one bus: their part of a configuration, and what stands for all of them.

A file gives each axis only what differs; what stands at the top level is every axis's default. The
configuration holds each axis whole, so that written out and read again it is the same.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Annotated, Any, Final

from pydantic import Field

from haptic_wall.controller.settings.axis_names import NAME
from haptic_wall.controller.settings.model import Model, Section, Wall, setting
from haptic_wall.controller.settings.servo import Baud, Port, Servo, truth_section
from haptic_wall.hw.settings import Way
from haptic_wall.hw.truth import TrueArm

SHARED: Final = (
    "backend",
    "port",
    "baud",
    "schedule",
    "watchdog_s",
    "faults",
    "fault_seed",
)
"""Fields of ``servo`` that belong to the bus, the same for every axis"""
RENAMED: Final = ("port", "baud")
"""Fields of ``bus`` that are another name of those of ``servo``"""
AxisName = Annotated[str, Field(pattern=f"^{NAME}$")]


class Bus(Section):
    """The bus of all servos."""

    port: Port | None = setting(None, "Serial device of all axes: sets servo.port", min_length=1)
    baud: Baud | None = setting(None, "Baud rate of all axes: sets servo.baud", "bit/s")
    read: Way = setting(
        "auto",
        "Request for the positions of several servos; fast: one joint reply; sync: a reply of "
        "each; plain: a request and a reply of each; auto: fast, else sync, with the reason",
        used_by=("emulated", "hardware"),
    )


if TYPE_CHECKING:

    class Arm(Section, TrueArm):
        """True parameters of an arm that simulated or emulated servos move."""

else:
    Arm = truth_section(TrueArm, Section, "arm.")


class Axis(Section):
    """The sections that each axis has of its own."""

    servo: Servo = Servo()
    model: Model = Model()
    wall: Wall = Wall()


OWN: Final = tuple(Axis.model_fields)
"""Names of these sections"""


def completed(data: dict[str, Any]) -> dict[str, Any]:
    """Return unchecked settings with port and baud of ``bus`` in ``servo``, and each axis whole."""
    bus, servo, axes = data.get("bus"), data.get("servo", {}), data.get("axes")
    if isinstance(bus, dict) and isinstance(servo, dict):
        moved = {name: bus[name] for name in RENAMED if bus.get(name) is not None}
        rest = {name: value for name, value in bus.items() if name not in moved}
        data = {**data, "bus": rest, "servo": servo | moved}
    if not isinstance(axes, dict):
        return data
    return {**data, "axes": {name: _completed(axis, data) for name, axis in axes.items()}}


def _completed(axis: Any, data: Mapping[str, Any]) -> Any:  # noqa: ANN401 - whatever the file holds
    if not isinstance(axis, dict):
        return axis
    whole = dict(axis)
    for section in OWN:
        default, own = data.get(section, {}), axis.get(section, {})
        if isinstance(default, dict) and isinstance(own, dict):
            whole[section] = default | own
    return whole


def compact(data: Mapping[str, Any]) -> dict[str, Any]:
    """Return dumped settings without nulls, and of each axis only what it has of its own."""
    short: dict[str, Any] = {
        section: {name: value for name, value in given.items() if value is not None}
        for section, given in data.items()
        if section != "axes"
    }
    if data["axes"]:
        short["axes"] = {
            name: {section: _own(axis[section], data[section]) for section in OWN}
            for name, axis in data["axes"].items()
        }
    return short


def _own(axis: Mapping[str, Any], default: Mapping[str, Any]) -> dict[str, Any]:
    return {
        name: value for name, value in axis.items() if name not in default or value != default[name]
    }
