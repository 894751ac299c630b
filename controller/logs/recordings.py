"""Reads a motion from a log of this program, with its configuration, or from a CSV."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace
from itertools import groupby, pairwise
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from haptic_wall.controller.detector.detection import position_step
from haptic_wall.controller.errors import UserError
from haptic_wall.controller.laws.wall import SIGNS
from haptic_wall.controller.logs.csv_recording import recordings_of_csv
from haptic_wall.controller.logs.file import is_log
from haptic_wall.controller.logs.reader import LogReader
from haptic_wall.controller.logs.recording import LEAST, Knowledge, Part, Recording, parted
from haptic_wall.controller.logs.walls import Walls, walls_of
from haptic_wall.controller.logs.windows import WINDOW, Window, windows
from haptic_wall.controller.runtime.telemetry import FLAG_WARM_UP
from haptic_wall.controller.settings.config import Config
from haptic_wall.controller.system.printable import in_line
from haptic_wall.controller.theory.checks import FloatArray, IntArray
from haptic_wall.hw.servo import Outcome

MOST_LAG_S = 10.0
"""Longest time between a sample and its torque [s]; acting torques are kept for this long"""
MOVED = "position or law of the wall changed: each stretch is judged with its own wall"


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

    Raises:
        UserError: The wall was on for too short a time.
        LogFormatError: The file is not a log of this program.
        OSError: It cannot be read, or is no regular file.
    """
    log = LogReader.open(path)
    count, first_ns, started_at = 0, None, math.nan
    for rows in log.blocks():
        known = rows["position"][np.isfinite(rows["position"])]
        if math.isnan(started_at) and known.size:
            started_at = float(known[0])
        on = rows[(rows["flags"] & FLAG_WARM_UP) == 0]
        if first_ns is None and on.size:
            first_ns = int(on["deadline_ns"][0])
        count += on.size
    if first_ns is None or count < LEAST:
        raise UserError(
            f"found {count} rows with the wall on",
            field="LOG",
            given=path,
            wanted=f"at least {LEAST}",
            advice="record a longer run",
        )
    walls = walls_of(log.metadata, log.changes)
    notes = [
        f"{in_line(law)} is not imported for a log: the motion is judged without its law"
        for law in walls.closed()
    ]
    if walls.moves():
        notes.append(MOVED)
    for index, blocks in groupby(_with_wall_on(log, walls), key=lambda found: found[0]):
        config = walls.configs[index]
        # An experiment's program renders several walls of its own.
        surface = math.nan if "phases" in log.metadata else config.surface(started_at)
        for window in windows(block for _, block in blocks):
            found = _of_rows(window, first_ns, config, surface)
            yield replace(found, of=-(-count // WINDOW), notes=(*notes, *found.notes))
            notes = []


def _with_wall_on(log: LogReader, walls: Walls) -> Iterator[tuple[int, NDArray[np.void]]]:
    """Yield blocks of rows with the wall on, each of one wall, with the index of that wall."""
    moves = walls.moves()
    since = [walls.since[index] for index in moves]
    for rows in log.blocks():
        on = rows[(rows["flags"] & FLAG_WARM_UP) == 0]
        edges = [0, *np.searchsorted(on["seq"], since).tolist(), len(on)]
        for index, (start, end) in zip([0, *moves], pairwise(edges), strict=True):
            if end > start:
                yield index, on[start:end]


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
