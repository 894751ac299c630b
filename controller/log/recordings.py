"""The motion in a record: in a log of ours, with what its configuration says, or in a CSV."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from pydantic import ValidationError

from controller.errors import LogFormatError, UserError
from controller.log.csv_recording import recording_of_csv
from controller.log.reader import SUFFIX, Damage, LogReader
from controller.log.recording import LEAST, Knowledge, Part, Recording, parted, position_count
from controller.log.rows import LogRows
from controller.log.windows import WINDOW, Window, windows
from controller.settings.config import Config
from controller.telemetry import FLAG_WARM_UP
from controller.wall import SIGNS
from hw.servo import Outcome


def read_recordings(path: Path) -> Iterator[Recording]:
    """Read a log of ours, or a CSV with the columns ``time_s``, ``position_rad``, ``torque_nm``.

    Args:
        path: What ends in .hwlog is a log, of which a long one comes in several recordings that
            overlap, so that never the whole is in memory; anything else is a CSV, one recording.
            The torque, the one commanded at that sample, may be missing.

    Raises:
        UserError: There is nothing in it to look at; the message says what was found.
        LogFormatError: It is not a log of ours.
        OSError: It cannot be read.
    """
    if path.suffix == SUFFIX:
        yield from recordings_of_log(path)
    else:
        yield recording_of_csv(path)


def recordings_of_log(path: Path) -> Iterator[Recording]:
    """The motion that a log of ours holds, a long one in several recordings that overlap.

    Raises:
        UserError: The wall was on too shortly.
        LogFormatError: It is not a log of ours.
        OSError: It cannot be read.
    """
    log = LogReader(path)
    for piece in log.pieces():
        if isinstance(piece, Damage):
            log.warn(piece)
    rows = LogRows.of(log)
    count, origin_ns = 0, 0
    for block in _with_wall_on(rows):
        origin_ns = origin_ns if count else int(block["deadline_ns"][0])
        count += len(block)
    if count < LEAST:
        raise UserError(
            f"LOG {path}: found {count} rows with the wall on, wanted at least {LEAST}; record"
            " a longer run"
        )
    try:
        config = Config.model_validate(log.metadata.get("config"))
    except ValidationError as error:
        raise LogFormatError(
            f"LOG {path}: its configuration is not one this program knows"
            f" ({error.error_count()} differences); read it with the haptic-wall that wrote it"
        ) from error
    # An experiment's program has walls of its own, one after the other.
    surface = math.nan if "phases" in log.metadata else config.surface(rows.started_at())
    of = -(-count // WINDOW)
    for window in windows(_with_wall_on(rows)):
        yield replace(_of_rows(window, origin_ns, config, surface), of=of)


def _with_wall_on(rows: LogRows) -> Iterator[NDArray[np.void]]:
    for block in rows.blocks():
        on = block[(block["flags"] & FLAG_WARM_UP) == 0]
        if on.size:
            yield on


def _of_rows(window: Window, origin_ns: int, config: Config, surface: float) -> Recording:
    rows = window.rows
    good = rows["outcome"] == Outcome.OK
    belief = config.belief()
    gain = belief.torque_gain.value
    age = float(np.median(rows["age_ns"][good])) * 1e-9 if good.any() else 0.0
    whole = Part(
        times=(rows["deadline_ns"] - origin_ns) * 1e-9,
        positions=np.where(good, rows["position"], np.nan),
        torques=rows["torque"].astype(np.float64),
        stiffness=rows["stiffness"].astype(np.float64),
    )
    notes: list[str] = []
    if not good.all():
        notes.append(f"{np.count_nonzero(~good)} readings failed or were late and are left out")
    known = Knowledge(
        inertia=belief.inertia.value / gain,
        damping=belief.damping.value / gain,
        coulomb=belief.coulomb.value / gain,
        lag=age + belief.delay.value,
        position_step=position_count(whole.positions),
        virtual_damping=float(np.median(rows["damping"])),
        surface=surface,
        side=0 if math.isnan(surface) else SIGNS[config.wall.side],
    )
    since_s = float(whole.times[window.seen]) if window.seen else -math.inf
    parts = parted(whole, config.period_s, notes)
    return Recording(config.period_s, parts, known, tuple(notes), since_s)
