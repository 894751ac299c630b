"""Draws the picture of a result; a picture that cannot be drawn does not cost the result."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from haptic_wall.controller.cli.options import say, writing
from haptic_wall.controller.cli.working import DRAWING_S, working
from haptic_wall.controller.errors import UserError
from haptic_wall.controller.system.files import whole


def drawn(option: str, path: Path, draw: Callable[[Path], None]) -> None:
    """Draw a picture; it is complete or absent.

    Args:
        option: That named the path.
        path: Of the picture.
        draw: Draws to a path.

    Raises:
        UserError: Whatever kept it from being drawn or written.
    """
    drawing = working("drawing the picture", DRAWING_S)
    try:
        with drawing, writing(option, path), whole(path) as part:
            draw(part)
    except UserError:
        raise
    except Exception as error:
        why = f"cannot be drawn: {error or type(error).__name__}"
        raise UserError(
            why, field=option, given=path, advice="see whether Matplotlib works"
        ) from error


def drawn_or_noted(option: str, path: Path, draw: Callable[[Path], None]) -> Path | None:
    """Draw a picture as ``drawn``; return its path, or None after a note."""
    try:
        drawn(option, path, draw)
    except UserError as error:
        older = f"; {path} is of an earlier result" if path.exists() else ""
        say(f"there is no new picture: {error}{older}")
        return None
    return path
