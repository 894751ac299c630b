"""Reads the joints of a robot's description: their names, and the ends of their motion."""

from __future__ import annotations

import itertools
import re
from collections.abc import Collection
from pathlib import Path
from typing import Final
from xml.etree import ElementTree

from haptic_wall.controller.errors import UserError
from haptic_wall.controller.settings.axis_names import MOST_AXES, MOST_NAME
from haptic_wall.controller.system import files
from haptic_wall.controller.system.printable import in_line
from haptic_wall.hw.errors import Problem

MOST_BYTES: Final = 2**20
"""Largest size of a description"""
_MOVING: Final = ("revolute", "continuous", "prismatic")


def joint_ranges(path: Path, margin: float) -> dict[str, tuple[float, float] | None]:
    """Return low and high end [rad] of each joint that moves, by a name that an axis can have.

    One that is not revolute has no ends (None): left out, it would shift the ids of those after it.
    Joints that move with another one (``mimic``) are left out.

    Args:
        path: A URDF file.
        margin: Distance of both ends from the joint's limits [rad].

    Raises:
        UserError: It is no such file, has no or too many joints, or a joint no range.
        OSError: It cannot be read.
    """
    try:
        text = files.content(path, MOST_BYTES).decode("utf-8")
        if "<!DOCTYPE" in text or "<!ENTITY" in text:
            raise _refused(path, "a document type, which may refer to other files")
        joints = ElementTree.fromstring(text).iter("joint")
    except (UnicodeDecodeError, ElementTree.ParseError) as error:
        raise _refused(path, f"no XML ({in_line(str(error))})") from None
    ranges: dict[str, tuple[float, float] | None] = {}
    for joint in joints:
        kind, limit = joint.get("type"), joint.find("limit")
        if kind not in _MOVING or joint.find("mimic") is not None:
            continue
        name = in_line(joint.get("name", ""))
        if kind != "revolute" or limit is None:
            ranges[_axis_name(name, ranges)] = None
            continue
        try:
            low, high = (float(limit.get(end, "0")) for end in ("lower", "upper"))
        except ValueError:
            raise _refused(path, f"limits of the joint {name} that are no numbers") from None
        if not -1e6 < low < high < 1e6:
            raise _refused(path, f"limits of the joint {name} that are no range")
        low, high = round(low + margin, 6), round(high - margin, 6)
        if not low < high:
            wanted = f"less than half the range of the joint {name}"
            raise UserError(f"found {margin:g}", field="--margin", wanted=wanted)
        ranges[_axis_name(name, ranges)] = low, high
    if not 0 < len(ranges) <= MOST_AXES:
        raise _refused(path, f"{len(ranges)} joints that move")
    return ranges


def _axis_name(joint: str, taken: Collection[str]) -> str:
    """Return the joint's name in the letters of an axis's, another one than those before."""
    plain = re.sub(r"[^a-z0-9]+", "_", joint.lower()).strip("_")
    name = (plain if plain[:1].isalpha() else f"joint_{plain}")[:MOST_NAME].rstrip("_")
    others = (f"joint_{number}" for number in itertools.count(len(taken) + 1))
    return next(each for each in itertools.chain((name,), others) if each not in taken)


def _refused(path: Path, found: str) -> UserError:
    wanted = f"a URDF with 1 to {MOST_AXES} joints that move"
    return UserError(Problem(f"found {found}", wanted=wanted, field="--urdf", given=str(path)))
