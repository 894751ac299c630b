"""Keeps an experiment's results in a file, line by line, so that an interrupted one goes on."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, Generic, TypeVar

from haptic_wall import __version__
from haptic_wall.controller.errors import UserError
from haptic_wall.controller.system.files import is_full
from haptic_wall.controller.system.json_text import RESULT_MARK

Key = TypeVar("Key")
Value = TypeVar("Value")


class Kept(Generic[Key, Value]):
    """Results by key: read at the start, and added to the file one by one.

    The first line of the file tells program and settings; each other line is one result. A line
    that was cut short when the program was killed is dropped. The file is first written with the
    first result.

    Args:
        path: The file.
        settings: All that the results depend on, as JSON can hold it.
        read: Returns key and result of a line's JSON.
        write: Returns the JSON of a key and a result.
        fresh: Discard the results of an earlier call.

    Attributes:
        done: The results.

    Raises:
        UserError: The file has results of other settings, or is not what this program writes, or
            cannot be read.
    """

    def __init__(
        self,
        path: Path,
        settings: Mapping[str, Any],
        read: Callable[[Any], tuple[Key, Value]],
        write: Callable[[Key, Value], Any],
        *,
        fresh: bool = False,
    ) -> None:
        self.done: dict[Key, Value] = {}
        self._path, self._read, self._write = path, read, write
        text = json.dumps({"program": __version__, **settings}, sort_keys=True)
        fingerprint = hashlib.sha256(text.encode()).hexdigest()
        self._head = _line({**RESULT_MARK, "fingerprint": fingerprint})
        self._size = 0
        try:
            kept = b"" if fresh or not path.exists() else path.read_bytes()
        except OSError as error:
            what = f"{path.name} cannot be read: {error.strerror or error}"
            raise refused(path.parent, what, "name another folder") from error
        whole = kept.rfind(b"\n") + 1
        if not whole and not self._head.startswith(kept):
            what = f"{path.name} is no file of this program"
            raise refused(path.parent, what, "name another folder, or remove it")
        kept = kept[:whole]
        lines = kept.splitlines(keepends=True)
        if lines and lines[0] != self._head:
            advice = "name another folder, or replace them by --force"
            raise refused(path.parent, "found results with other settings there", advice)
        for number, line in enumerate(lines[1:], 2):
            try:
                key, value = read(json.loads(line))
            except (ValueError, TypeError, KeyError, OverflowError, RecursionError):
                what = f"{path.name}, line {number}: found no result of this program"
                raise refused(path.parent, what, "delete that line") from None
            self.done[key] = value
        self._size = len(kept)

    def add(self, key: Key, value: Value) -> Value:
        """Store one more result; return it as a later call will read it.

        Raises:
            UserError: It cannot be written.
        """
        line = _line(self._write(key, value))
        try:
            with self._path.open("ab") as file:
                file.truncate(self._size)
                file.write(line if self._size else self._head + line)
                self._size = file.tell()
        except OSError as error:
            what = f"{self._path.name} cannot be written: {error.strerror or error}"
            advice = f"{'make room, or ' if is_full(error) else ''}name another place"
            raise refused(self._path.parent, what, advice) from error
        self.done[key] = self._read(json.loads(line))[1]
        return self.done[key]


def refused(folder: Path, found: str, advice: str) -> UserError:
    """Return the error about a folder that cannot be used."""
    return UserError(found, field="--out", given=folder, advice=advice)


def _line(content: object) -> bytes:
    return json.dumps(content).encode() + b"\n"
