"""A folder that results are kept in: known by their settings, never half written."""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import IO, Any

from controller import __version__
from controller.errors import UserError


def fingerprint(described: Mapping[str, Any]) -> str:
    """Differs when anything does that is described, the program's version too.

    Args:
        described: Everything the results depend on, as JSON can hold it.
    """
    text = json.dumps({"program": __version__, **described}, sort_keys=True)
    return hashlib.sha256(text.encode()).hexdigest()


def made(folder: Path, logs: str) -> None:
    """Make the folder, and the one for logs in it.

    Raises:
        UserError: It cannot be made, or written to.
    """
    try:
        (folder / logs).mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise UserError(
            f"--out {folder}: the folder cannot be made ({error.strerror}); name another place"
        ) from error
    if not os.access(folder, os.W_OK | os.X_OK):
        raise UserError(
            f"--out {folder}: found a folder without leave to write; name another place"
        )


@contextmanager
def replaced(path: Path) -> Iterator[IO[str]]:
    """Write a file anew: who reads it finds the old one or the new one, never half of one.

    Raises:
        OSError: It cannot be written; the old one stays.
    """
    part = path.with_name(f"{path.name}.part")
    part.unlink(missing_ok=True)
    try:
        with part.open("x", newline="", encoding="utf-8") as stream:
            yield stream
        part.replace(path)
    finally:
        part.unlink(missing_ok=True)
