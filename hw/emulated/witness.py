"""The witness: a record of every frame and of the true motion, independent of any controller.

CSV with the columns of ``COLUMNS``, which docs/how-to/emulated-bus.md explains. Rows are kept in
memory and written when the bus is idle, so that writing never delays a reply. A row has the true
state after all events of its instant; the ``error`` of an instruction whose CRC was wrong is 3.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from typing import NamedTuple, Self, TextIO

from haptic_wall.hw.emulated.servo import TrueState

COLUMNS = "time_s,event,id,instruction,position_rad,velocity_rad_s,torque_nm,error,params,fault"
_SECOND_NS = 1_000_000_000


class Event(NamedTuple):
    """One event; ``instruction`` and ``error`` are None for a ``state``."""

    time_ns: int
    event: str
    id: int
    instruction: int | None
    state: TrueState
    error: int | None
    params: bytes
    fault: str = ""


class Witness:
    """Writes rows to a text file; closes it when all are written.

    A file that cannot be written (a full disk) ends the record, never the bus: see ``failure``.

    Args:
        file: Open for writing; owned by the witness from now on.
    """

    def __init__(self, file: TextIO) -> None:
        self._file = file
        self._rows: deque[Event] = deque()
        self.failure: OSError | None = None
        """Why the record is incomplete; None: it is complete"""
        self._try(lambda: file.write(COLUMNS + "\n"))

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    @property
    def waiting(self) -> int:
        """Return the number of rows that are not written yet."""
        return len(self._rows)

    def add(self, row: Event) -> None:
        """Add a row; call in the order of time."""
        if self.failure is None:
            self._rows.append(row)

    def write(self, rows: int) -> None:
        """Write at most ``rows`` rows to the file."""
        count = min(rows, len(self._rows))
        lines = "".join(_line(self._rows.popleft()) for _ in range(count))
        self._try(lambda: self._file.write(lines))

    def flush(self) -> None:
        """Pass everything to the operating system, for other readers."""
        self.write(len(self._rows))
        self._try(self._file.flush)

    def close(self) -> None:
        """Write the rest and close the file."""
        if not self._file.closed:
            self.flush()
            self._try(self._file.close)

    def _try(self, action: Callable[[], object]) -> None:
        try:
            action()
        except OSError as error:
            self.failure = self.failure or error
            self._rows.clear()


def _line(row: Event) -> str:
    seconds, rest = divmod(row.time_ns, _SECOND_NS)
    position, velocity, torque = row.state
    instruction = "" if row.instruction is None else int(row.instruction)
    error = "" if row.error is None else int(row.error)
    return (
        f"{seconds}.{rest:09d},{row.event},{row.id},{instruction},"
        f"{position!r},{velocity!r},{torque!r},{error},{row.params.hex()},{row.fault}\n"
    )
