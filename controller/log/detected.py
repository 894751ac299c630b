"""What the detector sees in recordings, one after the other, in memory that does not grow."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, fields, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from controller.detector.detection import DetectionRecord, KnownWall, detect
from controller.detector.oscillation import DetectorSettings, State
from controller.log.recording import Part, Recording

SLICES = 2500
"""Into so many slices a picture parts what it draws; of each what is extreme is kept."""
_WHOLE = 4 * SLICES
_NOTES = 20
_DRAWN = 200
"""Stretches in a picture: each takes time to draw"""


@dataclass(slots=True)
class Detected:
    """What was seen in all of them."""

    period: float = math.nan
    """[s]"""
    known: dict[str, float] = field(default_factory=dict)
    """What was taken to be known of the servo, from the first recording"""
    position_step: float = math.nan
    """[rad]"""
    state: State = State.QUIET
    """The worst"""
    frequency_hz: float = math.nan
    """In that state, where it was largest"""
    amplitude: float = 0.0
    """[rad]"""
    growth: float = math.nan
    """[1/s]"""
    first_alarm_s: float = math.nan
    samples: int = 0
    parts: int = 0
    notes: list[str] = field(default_factory=list)
    drawn: list[tuple[Part, DetectionRecord]] = field(default_factory=list)
    """What a picture is drawn from, of so many stretches"""


def detect_all(recordings: Iterable[Recording], given: Mapping[str, float | None]) -> Detected:
    """Run the detector over recordings.

    Args:
        recordings: Of one motion.
        given: ``inertia``, ``damping``, ``coulomb``, ``lag`` in place of what they know; None:
            as they know it.
    """
    detected = Detected()
    more = 0
    for recording in recordings:
        known = {
            name: getattr(recording.known, name) if value is None else value
            for name, value in given.items()
        }
        known["lag"] = 0.0 if math.isnan(known["lag"]) else known["lag"]
        if not detected.known:
            detected.period, detected.known = recording.period, known
            detected.position_step = recording.known.position_step
        new = [note for note in recording.notes if note not in detected.notes]
        room = max(0, _NOTES - len(detected.notes))
        detected.notes += new[:room]
        more += len(new[room:])
        for part in recording.parts:
            _see(detected, recording, part, known)
    if detected.parts > _DRAWN:
        detected.notes.append(f"a picture shows the first {_DRAWN} stretches")
    if more:
        detected.notes.append(f"there are {more} more such notes")
    return detected


def _see(detected: Detected, recording: Recording, part: Part, known: dict[str, float]) -> None:
    settings = DetectorSettings(
        period=recording.period,
        inertia=known["inertia"],
        damping=known["damping"],
        coulomb=known["coulomb"],
        position_step=recording.known.position_step,
    )
    wall = KnownWall(
        math.nan if part.stiffness is None else part.stiffness,
        recording.known.virtual_damping,
        recording.known.surface,
        recording.known.side,
    )
    record = detect(part.times, part.positions, part.torques, settings, lag=known["lag"], wall=wall)
    new = np.flatnonzero(part.times >= recording.since_s)
    if new.size == 0:
        return
    part, record = _taken(part, record, new)
    detected.samples += new.size
    goes_on = part.times[0] == recording.since_s
    detected.parts += int(not goes_on)
    at = record.worst_at
    if (record.worst, record.amplitude[at]) > (detected.state, detected.amplitude):
        detected.state = record.worst
        detected.frequency_hz = float(record.frequency_hz[at])
        detected.amplitude = float(record.amplitude[at])
        detected.growth = float(record.growth[at])
    if math.isnan(detected.first_alarm_s):
        detected.first_alarm_s = record.first_alarm_s
    if part.times.size > _WHOLE:
        part, record = _taken(part, record, _telling(part, record, SLICES // recording.of + 1))
    if goes_on and detected.drawn and detected.parts <= _DRAWN:
        part, record = _joined(detected.drawn.pop(), (part, record))
    if len(detected.drawn) < _DRAWN:
        detected.drawn.append((part, record))


def _taken(
    part: Part, record: DetectionRecord, places: NDArray[np.intp]
) -> tuple[Part, DetectionRecord]:
    """Only some of the samples, and what is worst of those."""
    state, alarm = record.state[places], record.alarm[places]
    amplitude = record.amplitude[places]
    worst = State(int(state.max()))
    times = part.times[places]
    return (
        Part(
            times,
            part.positions[places],
            None if part.torques is None else part.torques[places],
            None if part.stiffness is None else part.stiffness[places],
        ),
        DetectionRecord(
            state,
            record.frequency_hz[places],
            amplitude,
            record.growth[places],
            alarm,
            worst,
            int(np.argmax(np.where(state == worst, amplitude, -1.0))),
            float(times[np.argmax(alarm)]) if alarm.any() else math.nan,
        ),
    )


def _joined(
    first: tuple[Part, DetectionRecord], second: tuple[Part, DetectionRecord]
) -> tuple[Part, DetectionRecord]:
    """A part and what follows it without a gap."""

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
    """Of each slice the ends, the extremes of position and amplitude, and the worst state."""
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
