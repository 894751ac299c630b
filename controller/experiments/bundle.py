"""Packs an acceptance into one zip file without personal data.

Texts are written anew: the names of user and machine, the home folder and the folders of this call
become placeholders. Logs go in as CSV tables of their rows.
"""

from __future__ import annotations

import getpass
import platform
import re
import socket
import tempfile
import zipfile
from collections.abc import Mapping
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

from haptic_wall import __version__
from haptic_wall.controller.errors import LogFormatError
from haptic_wall.controller.logs.csv_export import write_csv
from haptic_wall.controller.logs.file import SUFFIX
from haptic_wall.controller.logs.reader import LogReader

FILE = "acceptance.zip"
_TEXTS = (".json", ".yaml", ".csv", ".txt")
_PACKAGES = ("numpy", "scipy", "pyserial", "dynamixel-sdk", "pydantic")
_LEAST = 3
"""Shortest name that is looked for"""


def versions() -> dict[str, str | None]:
    """Return the versions on which a measurement may depend; nothing that names a person."""
    found: dict[str, str | None] = {
        "haptic-wall": __version__,
        "python": platform.python_version(),
        "system": f"{platform.system()} {platform.release()}",
        "machine": platform.machine(),
    }
    for name in _PACKAGES:
        try:
            found[name] = version(name)
        except PackageNotFoundError:
            found[name] = None
    return found


def scrubbed(text: str, folder: Path) -> str:
    """Return a text without personal names.

    Args:
        text: Any text, JSON too.
        folder: The folder of this call, which may name a person too.
    """
    home, host = Path.home(), socket.gethostname()
    paths = {str(folder.resolve()): "DIR", str(home): "HOME", str(home.resolve()): "HOME"}
    names = {_user(): "USER", **dict.fromkeys((host, platform.node(), host.split(".")[0]), "HOST")}
    for found in sorted(paths, key=len, reverse=True):
        if len(found) > 1:
            text = text.replace(found, paths[found])
    for found in sorted(names, key=len, reverse=True):
        if len(found) >= _LEAST:
            text = re.sub(rf"(?<![^\W_]){re.escape(found)}(?![^\W_])", names[found], text)
    return text


def _user() -> str:
    try:
        return getpass.getuser()
    except (KeyError, OSError):  # a user without a name
        return ""


def pack(path: Path, out: Path, folders: Mapping[str, Path], own: Mapping[str, str]) -> None:
    """Write the bundle.

    Args:
        path: The zip file.
        out: The folder of this call, as for ``scrubbed``.
        folders: Folders to pack, by their names in the bundle; logs of ``measured`` only.
        own: Texts that are given, by name.

    Raises:
        OSError: It cannot be written.
    """
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as bundle:
        for name, content in own.items():
            _add(bundle, name, scrubbed(content, out))
        for title, folder in folders.items():
            for file in sorted(folder.rglob("*")):
                if file.is_symlink() or not file.is_file():
                    continue
                name = scrubbed(f"{title}/{file.relative_to(folder)}", out)
                if file.suffix == SUFFIX and title == "measured":
                    _add(bundle, f"{name}.csv", _table(file))
                elif file.suffix == ".png":
                    _add(bundle, name, file.read_bytes())
                elif file.suffix in _TEXTS:
                    text = file.read_text(encoding="utf-8", errors="replace")
                    _add(bundle, name, scrubbed(text, out))


def _add(bundle: zipfile.ZipFile, name: str, content: str | bytes) -> None:
    """Add a file without its time and owner."""
    entry = zipfile.ZipInfo(name, (1980, 1, 1, 0, 0, 0))
    entry.compress_type = zipfile.ZIP_DEFLATED
    bundle.writestr(entry, content)


def _table(log: Path) -> bytes:
    """Return the rows of a log as a table: its texts may name a person."""
    try:
        with tempfile.TemporaryDirectory() as folder:
            table = Path(folder) / "rows.csv"
            write_csv(table, LogReader.open(log))
            return table.read_bytes()
    except (LogFormatError, OSError):
        return b"this log could not be read\n"
