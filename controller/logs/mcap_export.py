"""Exports the rows of a log as MCAP: JSON messages on one channel, for Foxglove and PlotJuggler."""

from __future__ import annotations

import json
from pathlib import Path

from haptic_wall import __version__
from haptic_wall.controller.errors import UserError
from haptic_wall.controller.logs.columns import COLUMNS, finite_rows
from haptic_wall.controller.logs.rows import LogRows

TOPIC = "haptic_wall"
"""Channel of the rows' messages."""
METADATA = "haptic_wall.json"
"""Name of the attachment with the log's metadata."""


def write_mcap(path: Path, rows: LogRows) -> None:
    """Write every row as a message; the time counts from the log's first row, as in the CSV.

    Raises:
        UserError: The library is not installed.
        OSError: The file cannot be written.
    """
    try:
        from mcap.writer import Writer
    except ImportError:
        raise UserError(
            "the library mcap is not installed",
            field="--mcap",
            advice="install it with, in the clone, pip install -e '.[mcap]'",
        ) from None

    with path.open("wb") as file:
        writer = Writer(file)
        writer.start(library=f"haptic-wall {__version__}")
        schema = writer.register_schema(
            name="haptic_wall.Row", encoding="jsonschema", data=json.dumps(_schema()).encode()
        )
        channel = writer.register_channel(topic=TOPIC, message_encoding="json", schema_id=schema)
        metadata = json.dumps(dict(rows.metadata)).encode()
        writer.add_attachment(0, 0, METADATA, "application/json", metadata)
        for block in rows.blocks():
            times = (block["deadline_ns"] - rows.origin_ns).tolist()
            for time_ns, seq, row in zip(
                times, block["seq"].tolist(), finite_rows(block, rows.origin_ns), strict=True
            ):
                writer.add_message(
                    channel, time_ns, json.dumps(row).encode(), time_ns, sequence=seq & 0xFFFFFFFF
                )
        writer.finish()  # type: ignore[no-untyped-call]


def _schema() -> dict[str, object]:
    return {
        "type": "object",
        "properties": {column: {"type": "number"} for column in COLUMNS},
    }
