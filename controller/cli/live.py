"""``haptic-wall live``: shows a recorded run in a browser."""

from __future__ import annotations

import asyncio
import socket
from pathlib import Path
from typing import TYPE_CHECKING

import click

from haptic_wall.controller.cli import interrupt
from haptic_wall.controller.cli.options import (
    place_option,
    put,
    reading,
    stretch_between,
    stretch_options,
)
from haptic_wall.controller.cli.working import working
from haptic_wall.controller.live.place import live_at
from haptic_wall.controller.logs.reader import LogReader
from haptic_wall.controller.logs.walls import walls_of

if TYPE_CHECKING:
    from haptic_wall.controller.live.view import View


@click.command()
@click.argument("log", type=click.Path(path_type=Path))
@place_option
@stretch_options
def command(log: Path, place: str, start_s: float | None, end_s: float | None) -> int:
    """Show LOG, a file that run wrote, in a browser, until Ctrl-C.

    The address is the first line on standard output. The page is that of `run --live` for a running
    wall: zoom, cursors, events.
    """
    stretch = stretch_between(start_s, end_s)
    live = live_at(place, field="--at")
    with socket.socket(fileno=live.descriptor) as listener:
        views = _views(log, stretch)
        put(live.address)
        from haptic_wall.controller.live.server import LiveServer

        with interrupt.until_signal() as came:
            asyncio.run(LiveServer(views, live.host).run(listener, lambda: bool(came)))
        return interrupt.status_after(came)


def _views(log: Path, stretch: tuple[float, float]) -> dict[str, View]:
    """Return the view of each axis by name."""
    from haptic_wall.controller.live.source import LoggedSource
    from haptic_wall.controller.live.view import View

    views = {}
    with reading("LOG", log, "a log of run"), working("reading the log"):
        whole = LogReader.open(log, stretch)
        parts = [(name, whole.axis(name)) for name in whole.axes]
        sources = [LoggedSource(part) for _, part in parts]
    for (name, read), source in zip(parts, sources, strict=True):
        walls = walls_of(read.metadata, read.changes)
        title = str(read.metadata.get("name", log.name))
        view = views[name] = View(walls.configs[0], title, source, recorded=True)
        begun = source.since(walls.since)
        states = [(*at, each) for at, each in zip(begun, walls.configs, strict=False)]
        view.recall(dict(read.end or {}), list(read.changes), states)
    return views
