"""Finds the names that a file imports."""

from __future__ import annotations

import ast
from pathlib import Path


def imported(path: Path) -> set[str]:
    """Names of what a file imports, with dots; those of the package from the top of the tree."""
    names: set[str] = set()
    for node in ast.walk(ast.parse(path.read_text("utf-8"))):
        if isinstance(node, ast.Import):
            names.update(part.name for part in node.names)
        elif isinstance(node, ast.ImportFrom) and node.module and not node.level:
            names.update((node.module, *(f"{node.module}.{part.name}" for part in node.names)))
    return {name.removeprefix("haptic_wall.") for name in names}
