"""Runs the detector over recordings, one after the other, in bounded memory."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, fields, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from haptic_wall.controller.detector.detection import DetectionRecord, Known, KnownWall, detect
from haptic_wall.controller.detector.state import State
from haptic_wall.controller.logs.recording import Part, Recording

SLICES = 2500
"""Number of slices of a picture's time axis; of each slice the extremes are kept."""
_WHOLE = 4 * SLICES
_NOTES = 20
_DRAWN = 200
"""Largest number of stretches in a picture: each takes time to draw"""


@dataclass(slots=True)
class Detected:
    """Result of the detector over all recordings."""

    period: float = math.nan
    """[s]"""
    known: dict[str, float] = field(default_factory=dict)
    """Servo parameters that the detector used, from the first recording"""
    wall: dict[str, float] = field(default_factory=dict)
    """Wall parameters that the detector used, from the first part: ``stiffness``,
    ``virtual_damping``, ``wall_position``"""
    position_step: float = math.nan
    """[rad]"""
    state: State = State.QUIET
    """The worst state"""
    frequency_hz: float = math.nan
    """In that state, at its largest amplitude"""
    amplitude: float = 0.0
    """[rad]"""
    growth: float = math.nan
    """[1/s]"""
    first_alarm_s: float = math.nan
    samples: int = 0
    parts: int = 0
    notes: list[str] = field(default_factory=list)
    drawn: list[tuple[Part, DetectionRecord]] = field(default_factory=list)
    """Samples of a limited number of stretches, for the picture"""


@dataclass(frozen=True, slots=True)
class GivenWall:
    """Wall parameters that the user gives; None: not given."""

    stiffness: float | None = None
    """K [N·m/rad]"""
    virtual_damping: float | None = None
    """B [N·m·s/rad]"""
    surface: float | None = None
    """Position of the wall's surface [rad]"""


NO_WALL = GivenWall()


def detect_all(
    recordings: Iterable[Recording], given: Mapping[str, float | None], wall: GivenWall = NO_WALL
) -> Detected:
    """Run the detector over recordings.

    Args:
        recordings: Recordings of one motion.
        given: ``inertia``, ``damping``, ``coulomb``, ``lag`` in place of the recordings' values;
            None: use theirs.
        wall: In place of the recordings' wall.
    """
    detected = Detected()
    more = 0
    for recording in recordings:
        known = {
            name: getattr(recording.known, name) if value is None else value
            for name, value in given.items()
        }
        if not math.isnan(known["inertia"]) and math.isnan(known["lag"]):
            known["lag"] = 0.0
        if not detected.known:
            detected.period, detected.known = recording.period, known
            detected.position_step = recording.known.position_step
        new = [note for note in recording.notes if note not in detected.notes]
        room = max(0, _NOTES - len(detected.notes))
        detected.notes += new[:room]
        more += len(new[room:])
        for part in recording.parts:
            _see(detected, recording, part, known, wall)
    if detected.parts > _DRAWN:
        detected.notes.append(f"the picture shows only the first {_DRAWN} stretches")
    if more:
        detected.notes.append(f"there are {more} more such notes")
    return detected


def _see(
    detected: Detected,
    recording: Recording,
    part: Part,
    known: dict[str, float],
    given: GivenWall,
) -> None:
    settings = Known(recording.period, known["inertia"], recording.known.position_step)
    wall = _wall(detected, recording, part, given)
    record = detect(part.times, part.positions, part.torques, settings, lag=known["lag"], wall=wall)
    new = np.flatnonzero(part.times >= recording.since_s)
    if new.size == 0:
        return
    goes_on = bool(part.times[new[0]] == recording.since_s)
    add(detected, *_taken(part, record, new), goes_on=goes_on, of=recording.of)


def _wall(detected: Detected, recording: Recording, part: Part, given: GivenWall) -> KnownWall:
    """Return the wall as given by the user, else as recorded."""
    knows = recording.known
    wall = KnownWall()
    if part.stiffness is not None:
        wall = KnownWall(part.stiffness, knows.virtual_damping, knows.surface, knows.side)
    told = {name: getattr(given, name) for name in ("stiffness", "virtual_damping", "surface")}
    wall = replace(wall, **{name: value for name, value in told.items() if value is not None})
    if not detected.wall:
        detected.wall = {
            "stiffness": float(np.asarray(wall.stiffness).flat[0]),
            "virtual_damping": wall.virtual_damping,
            "wall_position": wall.surface,
        }
    return wall


def add(
    detected: Detected, part: Part, record: DetectionRecord, *, goes_on: bool, of: int = 1
) -> None:
    """Add the detector's result for a part.

    Args:
        detected: The results so far.
        part: The motion.
        record: The result for this motion.
        goes_on: Whether the part follows the one before without a gap.
        of: Smallest number of parts to expect.
    """
    detected.samples += part.times.size
    detected.parts += int(not goes_on)
    at = record.worst_at
    if (record.worst, record.amplitude[at]) > (detected.state, detected.amplitude):
        detected.state = record.worst
        quiet = record.worst == State.QUIET
        detected.amplitude = 0.0 if quiet else float(record.amplitude[at])
        detected.frequency_hz = math.nan if quiet else float(record.frequency_hz[at])
        detected.growth = math.nan if quiet else float(record.growth[at])
    if math.isnan(detected.first_alarm_s):
        detected.first_alarm_s = record.first_alarm_s
    if part.times.size > _WHOLE:
        part, record = _taken(part, record, _telling(part, record, SLICES // of + 1))
    if goes_on and detected.drawn and detected.parts <= _DRAWN:
        part, record = _joined(detected.drawn.pop(), (part, record))
    if len(detected.drawn) < _DRAWN:
        detected.drawn.append((part, record))


def _taken(
    part: Part, record: DetectionRecord, places: NDArray[np.intp]
) -> tuple[Part, DetectionRecord]:
    """Return the samples at ``places``, and the worst state among them."""
    times = part.times[places]
    return (
        Part(
            times,
            part.positions[places],
            None if part.torques is None else part.torques[places],
            None if part.stiffness is None else part.stiffness[places],
        ),
        DetectionRecord.of(
            times,
            record.state[places],
            record.frequency_hz[places],
            record.amplitude[places],
            record.growth[places],
            record.alarm[places],
        ),
    )


def _joined(
    first: tuple[Part, DetectionRecord], second: tuple[Part, DetectionRecord]
) -> tuple[Part, DetectionRecord]:
    """Join a part and its successor without a gap."""

    def both(a: Any, b: Any) -> Any:  # noqa: ANN401 - arrays of any type, or None
        return None if a is None or b is None else np.concatenate([a, b])

    part = Part(
        *(both(getattr(first[0], f.name), getattr(second[0], f.name)) for f in fields(Part))
    )
    arrays = ("state", "frequency_hz", "amplitude", "growth", "alarm")
    joined = {name: both(getattr(first[1], name), getattr(second[1], name)) for name in arrays}
    record = replace(first[1], **joined)
    return _taken(part, record, np.arange(part.times.size))


def _telling(part: Part, record: DetectionRecord, slices: int) -> NDArray[np.intp]:
    """Return the indices of samples to draw: each slice's ends, extremes, worst state."""
    places: set[int] = set()
    for inside in np.array_split(np.arange(part.times.size), slices):
        state = record.state[inside]
        places |= {int(inside[0]), int(inside[-1])}
        places |= {int(inside[np.argmax(record.amplitude[inside])])}
        worst = int(np.argmax(state))
        places |= {int(inside[worst]), int(inside[min(worst + 1, inside.size - 1)])}
        known = inside[np.isfinite(part.positions[inside])]
        if known.size:
            of = part.positions[known]
            places |= {int(known[np.argmin(of)]), int(known[np.argmax(of)])}
    return np.array(sorted(places))
