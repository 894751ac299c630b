"""Serves the page of a running wall, with a view of each axis, in a thread of the door."""

from __future__ import annotations

import asyncio
import contextlib
import json
import socket
import time
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from haptic_wall.controller.errors import HapticWallError
from haptic_wall.controller.live.dead_man import DeadMan
from haptic_wall.controller.live.marks import Mark, change_mark
from haptic_wall.controller.live.place import Live
from haptic_wall.controller.live.server import LiveServer
from haptic_wall.controller.live.source import RunningSource
from haptic_wall.controller.live.view import View
from haptic_wall.controller.runtime.idle_window import until_idle_window
from haptic_wall.controller.runtime.realtime import stand_back
from haptic_wall.controller.runtime.telemetry import Telemetry, Word
from haptic_wall.controller.settings.axis_names import of_axis
from haptic_wall.controller.settings.changes import with_changes
from haptic_wall.controller.settings.config import RUNS, Config
from haptic_wall.controller.settings.load import loaded
from haptic_wall.controller.system.orders import say
from haptic_wall.hw.hand import SharedHand

_MOST_NEWS = 65_536
"""Largest message of the supervisor [bytes]"""


class News:
    """Receives messages of the supervisor about the run, and passes them to the views.

    Args:
        line: Socket from the supervisor; each message is one JSON object.
        telemetry: Of the run.
        views: Of each axis by name.
    """

    def __init__(
        self, line: socket.socket, telemetry: Telemetry, views: Mapping[str, View]
    ) -> None:
        self._line = line
        self._words = telemetry.words
        self._views = views
        self.over = False
        """Whether the run has ended, and nothing more comes"""

    def take(self) -> None:
        """Read the messages that have come, and show them."""
        try:
            while found := self._line.recv(_MOST_NEWS, socket.MSG_DONTWAIT):
                self._show(json.loads(found))
        except BlockingIOError:
            return  # none more
        except OSError:
            pass  # the supervisor is gone
        self.over = True

    def _show(self, news: dict[str, Any]) -> None:
        views, origin_ns = self._views.values(), self._words[Word.BEGAN_NS]
        if "note" in news and origin_ns:
            at_ns = news["at_ns"] - self._words[Word.OFFSET_NS]
            mark = Mark((at_ns - origin_ns) * 1e-9, "note", news["note"])
            for view in views:
                view.add([mark])
        elif "ended" in news:
            for view in views:
                view.end(f"the run is over: {news['ended']}")
        elif "change" in news:
            change = news["change"]
            if change["outcome"] == "applied":
                for name, view in self._views.items():
                    if new := of_axis(change["changed"], name):
                        with contextlib.suppress(HapticWallError):
                            config = loaded(with_changes(view.config, new), "of the running wall")
                            view.change(config, change["at_s"])
            if change["at_s"] is not None:
                for view in views:
                    view.add([change_mark(change)])


def serve_page(orders: Mapping[str, Any], ends: Callable[[], bool]) -> None:
    """Serve the page until ``ends``; tell the supervisor if it is gone sooner.

    Args:
        orders: Of the run's supervisor; the page takes the descriptors in them.
        ends: Whether a signal asked for the end.
    """
    stand_back()
    try:
        _serve(orders, Live(**orders["live"]), ends)
    except Exception as error:  # noqa: BLE001 - whatever it is, changes go on
        why = getattr(error, "strerror", None) or f"{type(error).__name__}: {error}"
        say({"page": f"the page is gone ({why})"})


def _serve(orders: Mapping[str, Any], live: Live, ends: Callable[[], bool]) -> None:
    config = Config.model_validate_json(orders["config"], context=RUNS)
    telemetry = Telemetry(orders["telemetry"], axes=len(config.each))
    hand = None if orders["hand"] is None else SharedHand(orders["hand"])
    dead_man = DeadMan(telemetry.words) if orders["dead_man"] else None
    views = {
        name: View(
            each,
            orders["name"],
            RunningSource(telemetry, config.period_ns, index),
            recorded=False,
            hand=None if hand is None else hand.of(index),
            dead_man=dead_man,
            now_ns=lambda: time.monotonic_ns() - telemetry.words[Word.OFFSET_NS],
        )
        for index, (name, each) in enumerate(config.each.items())
    }
    news = News(socket.socket(fileno=orders["news"]), telemetry, views)
    period_ns: int = orders["period_ns"]

    def until() -> bool:
        over = ends()
        news.take()
        return over

    def pause(wanted_s: float) -> float:
        return until_idle_window(telemetry.words, period_ns, wanted_s)

    server = LiveServer(views, live.host, live.token, Path(orders["run"]), pause)
    asyncio.run(server.run(socket.socket(fileno=live.descriptor), until))
