"""Reads a motion from a log of this program, with its configuration, or from a CSV."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import groupby, pairwise
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from haptic_wall.controller.detector.detection import position_step
from haptic_wall.controller.errors import UserError
from haptic_wall.controller.laws.wall import SIGNS
from haptic_wall.controller.logs.csv_recording import recordings_of_csv
from haptic_wall.controller.logs.pieces import End, Event, Head, Piece, fault_text
from haptic_wall.controller.logs.reader import LogReader, is_log
from haptic_wall.controller.logs.recording import LEAST, Knowledge, Part, Recording, parted
from haptic_wall.controller.logs.rows import LogRows
from haptic_wall.controller.logs.walls import Walls, changes_in, walls_of
from haptic_wall.controller.logs.windows import WINDOW, Window, windows
from haptic_wall.controller.runtime.telemetry import FLAG_WARM_UP
from haptic_wall.controller.settings.config import Config
from haptic_wall.controller.system.printable import in_line
from haptic_wall.controller.theory.checks import FloatArray, IntArray
from haptic_wall.hw.servo import Outcome

MOST_LAG_S = 10.0
"""Longest time between a sample and its torque [s]; acting torques are kept for this long"""
MOVED = "position or law of the wall changed: each stretch is judged with its own wall"
_MOST_TOLD = 5
"""Largest number of damaged places reported one by one"""


def read_recordings(path: Path) -> Iterator[Recording]:
    """Read a log, or a CSV with the columns ``time_s``, ``position_rad``, ``torque_nm``.

    Args:
        path: A file with a log's content is a log, whatever its name. A long log gives several
            recordings that overlap, so that the whole is never in memory. Any other file is a CSV;
            its torque, the one commanded at that sample, may be missing.

    Raises:
        UserError: The file holds no usable motion; the message says what was found.
        LogFormatError: The file is not a log of this program.
        OSError: It cannot be read, or is no regular file.
    """
    if is_log(path):
        yield from recordings_of_log(path)
    else:
        yield from recordings_of_csv(path)


def recordings_of_log(path: Path) -> Iterator[Recording]:
    """Yield the motion of a log; a long log gives several recordings that overlap.

    Each of several logs joined in one file is a recording of its own.

    Raises:
        UserError: The wall was on for too short a time.
        LogFormatError: The file is not a log of this program.
        OSError: It cannot be read, or is no regular file.
    """
    rows = LogRows.of(LogReader(path))
    logs, notes = _looked_through(rows)
    count = sum(each.count for each in logs)
    if all(each.count < LEAST for each in logs):
        raise UserError(
            f"found {count} rows with the wall on",
            field="LOG",
            given=path,
            wanted=f"at least {LEAST}",
            advice="record a longer run",
        )
    walls = [
        walls_of(each.metadata, changes_in(each.told)) if each.count >= LEAST else None
        for each in logs
    ]
    of = sum(-(-each.count // WINDOW) for each in logs)
    origin_ns = next(each.origin_ns for each in logs if each.count)
    notes += [
        f"{each.count} rows of part {number} with the wall on are too few to analyse"
        for number, each in enumerate(logs, 1)
        if each.count < LEAST
    ]
    closed = {law for each in walls if each is not None for law in each.closed()}
    notes += [
        f"{in_line(law)} is not imported for a log: the motion is judged without its law"
        for law in closed
    ]
    if any(each is not None and each.moves() for each in walls):
        notes.append(MOVED)
    for (number, index), blocks in groupby(_with_wall_on(rows, walls), key=lambda found: found[0]):
        if (known := walls[number]) is None:
            continue
        config = known.configs[index]
        # An experiment's program renders several walls of its own.
        surface = config.surface(logs[number].started_at)
        surface = math.nan if "phases" in logs[number].metadata else surface
        for window in windows(block for _, block in blocks):
            found = _of_rows(window, origin_ns, config, surface)
            yield replace(found, of=of, notes=(*notes, *found.notes))
            notes = []


@dataclass(slots=True)
class _Log:
    """One log of a file; a file may hold several."""

    metadata: Mapping[str, Any]
    count: int = 0
    """Rows with the wall on"""
    origin_ns: int = 0
    """Deadline of the first of these rows [ns]"""
    started_at: float = math.nan
    """The first position of the run [rad]; NaN: the beginning is missing or damaged"""
    begins: bool = True
    """Whether no row is missing before the present one"""
    told: list[Piece] = field(default_factory=list)
    """Events and ends"""


def _looked_through(rows: LogRows) -> tuple[list[_Log], list[str]]:
    """Read the file once; return each log in it, and sentences about faults."""
    logs = [_Log(rows.metadata, begins="cut" not in rows.metadata)]
    notes: list[str] = []
    wrong = 0
    for piece in rows.pieces():
        log = logs[-1]
        if isinstance(piece, np.ndarray):
            position: FloatArray = piece["position"]
            known = position[np.isfinite(position)]
            if log.begins and known.size:
                log.started_at, log.begins = float(known[0]), False
            on = piece[(piece["flags"] & FLAG_WARM_UP) == 0]
            if on.size and log.count == 0:
                log.origin_ns = int(on["deadline_ns"][0])
            log.count += on.size
        elif isinstance(piece, Head):
            logs.append(_Log(piece.metadata, begins="cut" not in piece.metadata))
            name = in_line(str(piece.metadata.get("name", "unknown")))
            notes.append(f"part {len(logs)} is another log, {name}, joined to the one before")
        elif isinstance(piece, End | Event):
            log.told.append(piece)
        else:
            log.begins = False
            new = list(fault_text(piece))
            notes += new[: max(0, _MOST_TOLD - wrong)]
            wrong += len(new)
    if wrong > _MOST_TOLD:
        notes.append(f"there are {wrong - _MOST_TOLD} more such places")
    return logs, notes


def _with_wall_on(
    rows: LogRows, walls: Sequence[Walls | None]
) -> Iterator[tuple[tuple[int, int], NDArray[np.void]]]:
    """Yield blocks of rows with the wall on, each of one wall.

    With them comes the index of their log in the file, and that of their configuration in it.
    """
    number = 0
    for piece in rows.pieces():
        if isinstance(piece, Head):
            number += 1
        elif isinstance(piece, np.ndarray) and number < len(walls):  # else joined meanwhile
            on = piece[(piece["flags"] & FLAG_WARM_UP) == 0]
            known = walls[number]
            moves = [] if known is None else known.moves()
            since = [] if known is None else [known.since[index] for index in moves]
            edges = [0, *np.searchsorted(on["seq"], since).tolist(), len(on)]
            for index, (start, end) in zip([0, *moves], pairwise(edges), strict=True):
                if end > start:
                    yield (number, index), on[start:end]


def _of_rows(window: Window, origin_ns: int, config: Config, surface: float) -> Recording:
    rows = window.rows
    position: FloatArray = rows["position"]
    good: NDArray[np.bool_] = (rows["outcome"] == Outcome.OK) & np.isfinite(position)
    belief = config.belief()
    gain = belief.torque_gain.value
    ages: IntArray = rows["age_ns"][good]
    age = float(np.median(ages)) * 1e-9 if good.any() else 0.0
    whole = Part(
        times=(rows["deadline_ns"] - origin_ns) * 1e-9,
        positions=np.where(good, position, np.nan),
        torques=rows["torque"].astype(np.float64),
        stiffness=rows["stiffness"].astype(np.float64),
    )
    notes: list[str] = []
    if not good.all():
        notes.append(f"{np.count_nonzero(~good)} readings failed or were late and are left out")
    lag = age + belief.delay.value
    if lag > MOST_LAG_S:
        notes.append(
            f"torques act {lag:.4g} s after their samples: this counts as {MOST_LAG_S:g} s"
        )
    known = Knowledge(
        inertia=belief.inertia.value / gain,
        damping=belief.damping.value / gain,
        coulomb=belief.coulomb.value / gain,
        lag=min(lag, MOST_LAG_S),
        position_step=position_step(whole.positions),
        virtual_damping=float(np.median(rows["damping"])),
        surface=surface,
        side=0 if math.isnan(surface) else SIGNS[config.wall.acting_side],
    )
    since_s = float(whole.times[window.seen]) if window.seen else -math.inf
    parts = parted(whole, config.period_s, notes)
    return Recording(config.period_s, parts, known, tuple(notes), since_s)
