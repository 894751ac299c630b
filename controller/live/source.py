"""Provides the rows of a view: from a running loop's memory, or from a log."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray

from haptic_wall.controller.errors import UserError
from haptic_wall.controller.logs.reader import LogReader
from haptic_wall.controller.runtime.telemetry import Telemetry, Word

BACK_S: Final = 60.0
"""Time before a client's arrival for which it gets the rows [s]"""
MOST_ROWS: Final = 900_000
"""Rows of a log that can be shown: a quarter of an hour at 1 kHz, 60 MB in the browser"""


class RunningSource:
    """The rows of one axis of a running loop.

    Args:
        telemetry: Its memory.
        period_ns: Of the loop [ns].
        axis: Index of the axis.

    Attributes:
        capacity: Number of rows that a page keeps.
        alone: Whether the run has no other axis.
    """

    def __init__(self, telemetry: Telemetry, period_ns: int, axis: int = 0) -> None:
        self._telemetry, self._axis = telemetry, axis
        self.alone = telemetry.axes == 1
        self.capacity = round(BACK_S * 1e9 / period_ns)

    def origin_ns(self) -> int:
        """Return the first deadline [ns]; 0: the loop does not run yet."""
        return int(self._telemetry.words[Word.BEGAN_NS])

    def health(self) -> tuple[float, float] | None:
        """Return supply [V] and temperature [°C] of the hottest servo; None: not known yet."""
        words = self._telemetry.words
        found = words[Word.SUPPLY_MV] / 1e3, words[Word.TEMPERATURE_MC] / 1e3
        return found if found[0] else None

    def stopped(self) -> bool:
        """Whether the axis of the view ended the run, as one of several."""
        return bool(self._telemetry.words[Word.STOP_AXIS] == self._axis + 1)

    def first(self) -> int:
        """Return the number of the row a minute ago."""
        return max(0, int(self._telemetry.words[Word.HEAD]) - self.capacity)

    def read(self, tail: int, most: int) -> tuple[NDArray[np.void], int]:
        """Return rows of the axis from ``tail`` on, and the next tail; see ``Telemetry.read``."""
        rows, after = self._telemetry.read(tail, most)
        return rows[:, self._axis], after


class LoggedSource:
    """The rows of one axis of a log, in memory; attributes as of ``RunningSource``.

    Args:
        log: The log, or a stretch of it.

    Raises:
        UserError: The log has no rows, or more than a page can show.
        LogFormatError: The log is damaged.
        OSError: The log cannot be read.
    """

    def __init__(self, log: LogReader) -> None:
        blocks: list[NDArray[np.void]] = []
        for block in log.blocks():
            blocks.append(block)
            if sum(map(len, blocks)) > MOST_ROWS:
                raise UserError(
                    f"holds more than {MOST_ROWS} rows in this stretch",
                    field="LOG",
                    given=log.path,
                    advice="choose a shorter stretch with --from and --to",
                )
        if not blocks:
            raise UserError("holds no rows in this stretch", field="LOG", given=log.path)
        self.rows = np.concatenate(blocks)
        self._origin_ns = log.origin_ns
        self.capacity = len(self.rows)
        self.alone = True

    def origin_ns(self) -> int:
        """Return the deadline of the log's first row [ns]."""
        return self._origin_ns

    def health(self) -> None:
        """Return None: a log does not have it."""

    def stopped(self) -> bool:
        """Return False: the end of a log says it in words."""
        return False

    def since(self, numbers: Sequence[int]) -> list[tuple[int, float]]:
        """Return place and time [s] of each row, by its number; without those behind the end."""
        places = np.searchsorted(self.rows["seq"], numbers)
        places = places[places < len(self.rows)]
        times = (self.rows["deadline_ns"][places] - self._origin_ns) * 1e-9
        return list(zip(places.tolist(), times.tolist(), strict=True))

    def first(self) -> int:
        """Return 0: all rows are sent."""
        return 0

    def read(self, tail: int, most: int) -> tuple[NDArray[np.void], int]:
        """Return rows from place ``tail`` on, and the next place."""
        rows = self.rows[tail : tail + most]
        return rows, tail + len(rows)


Source = RunningSource | LoggedSource
"""Rows of a run, for the view of one axis"""
