"""Reads a motion from a log of this program, with its configuration, or from a CSV."""

from __future__ import annotations

import math
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from numpy.lib.recfunctions import repack_fields
from numpy.typing import NDArray

from haptic_wall.controller.detector.detection import position_step
from haptic_wall.controller.errors import UserError
from haptic_wall.controller.laws.wall import SIGNS
from haptic_wall.controller.logs.csv_recording import recordings_of_csv
from haptic_wall.controller.logs.csv_table import MOST_ROWS
from haptic_wall.controller.logs.file import is_log
from haptic_wall.controller.logs.reader import LogReader
from haptic_wall.controller.logs.recording import (
    LEAST,
    WINDOW,
    Knowledge,
    Part,
    Recording,
    parted,
    windowed,
)
from haptic_wall.controller.logs.walls import walls_of
from haptic_wall.controller.runtime.telemetry import FLAG_WARM_UP
from haptic_wall.controller.settings.config import Config
from haptic_wall.controller.system.printable import in_line
from haptic_wall.controller.theory.checks import FloatArray, IntArray
from haptic_wall.hw.servo import Outcome

MOST_LAG_S = 10.0
"""Longest time between a sample and its torque [s]; acting torques are kept for this long"""
_USED = ["deadline_ns", "position", "torque", "stiffness", "damping", "outcome", "age_ns"]


def read_recordings(path: Path) -> Iterator[Recording]:
    """Read a log, or a CSV with the columns ``time_s``, ``position_rad``, ``torque_nm``.

    Args:
        path: A file with a log's content is a log, whatever its name. Any other file is a CSV; its
            torque, the one commanded at that sample, may be missing. A long one gives several
            recordings that overlap.

    Raises:
        UserError: The file holds no usable motion; the message says what was found.
        LogFormatError: The file is not a log of this program.
        OSError: It cannot be read, or is no regular file.
    """
    return recordings_of_log(path) if is_log(path) else recordings_of_csv(path)


def recordings_of_log(path: Path) -> Iterator[Recording]:
    """Yield the motion of a log while the wall was on, with what its configuration knows.

    Raises:
        UserError: The wall was on for too short a time, or for too long.
        LogFormatError: The file is not a log of this program.
        OSError: It cannot be read, or is no regular file.
    """
    log = LogReader.open(path)
    held: list[NDArray[np.void]] = []
    count, started_at = 0, math.nan
    for block in log.blocks():
        known = block["position"][np.isfinite(block["position"])]
        if math.isnan(started_at) and known.size:
            started_at = float(known[0])
        held.append(repack_fields(block[_USED][(block["flags"] & FLAG_WARM_UP) == 0]))
        count += held[-1].size
        if count > MOST_ROWS:
            break
    if not LEAST <= count <= MOST_ROWS:
        raise UserError(
            f"found {count if count < LEAST else f'more than {MOST_ROWS}'} rows with the wall on",
            field="LOG",
            given=path,
            wanted=f"from {LEAST} to {MOST_ROWS}",
        )
    walls = walls_of(log.metadata, log.changes)
    notes = [
        f"{in_line(law)} is not imported for a log: the motion is judged without its law"
        for law in walls.closed()
    ]
    config = walls.configs[0]
    surface = config.surface(started_at)
    if walls.moves() or "phases" in log.metadata:  # an experiment's program renders several walls
        surface = math.nan
        notes.append("the wall changed: the motion is judged without its position")
    whole, knowledge = _of_rows(np.concatenate(held), config, surface, notes)
    for some, since_s in windowed(parted(whole, config.period_s, notes)):
        of = -(-count // WINDOW)
        yield Recording(config.period_s, some, knowledge, tuple(notes), since_s, of)
        notes = []
    if notes:
        yield Recording(config.period_s, (), knowledge, tuple(notes))


def _of_rows(
    rows: NDArray[np.void], config: Config, surface: float, notes: list[str]
) -> tuple[Part, Knowledge]:
    position: FloatArray = rows["position"]
    good: NDArray[np.bool_] = (rows["outcome"] == Outcome.OK) & np.isfinite(position)
    belief = config.belief()
    gain = belief.torque_gain.value
    ages: IntArray = rows["age_ns"][good]
    age = float(np.median(ages)) * 1e-9 if good.any() else 0.0
    whole = Part(
        times=(rows["deadline_ns"] - rows["deadline_ns"][0]) * 1e-9,
        positions=np.where(good, position, np.nan),
        torques=rows["torque"].astype(np.float64),
        stiffness=rows["stiffness"].astype(np.float64),
    )
    if not good.all():
        notes.append(f"{np.count_nonzero(~good)} readings failed or were late and are left out")
    lag = age + belief.delay.value
    if lag > MOST_LAG_S:
        notes.append(
            f"torques act {lag:.4g} s after their samples: this counts as {MOST_LAG_S:g} s"
        )
    return whole, Knowledge(
        inertia=belief.inertia.value / gain,
        damping=belief.damping.value / gain,
        coulomb=belief.coulomb.value / gain,
        lag=min(lag, MOST_LAG_S),
        position_step=position_step(whole.positions),
        virtual_damping=float(np.median(rows["damping"])),
        surface=surface,
        side=0 if math.isnan(surface) else SIGNS[config.wall.acting_side],
    )
