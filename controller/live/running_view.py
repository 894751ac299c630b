"""Makes the view of a running wall, from what its supervisor sends."""

from __future__ import annotations

import contextlib
import json
import socket
import time
from collections.abc import Mapping
from typing import Any

from haptic_wall.controller.errors import HapticWallError
from haptic_wall.controller.live.dead_man import DeadMan
from haptic_wall.controller.live.marks import Mark, change_mark
from haptic_wall.controller.live.source import RunningSource
from haptic_wall.controller.live.view import View
from haptic_wall.controller.runtime.telemetry import Telemetry, Word
from haptic_wall.controller.settings.changes import changed
from haptic_wall.controller.settings.config import RUNS, Config
from haptic_wall.hw.hand import SharedHand

_MOST_NEWS = 65_536
"""Largest message of the supervisor [bytes]"""


class News:
    """Receives messages of the supervisor about the run, and passes them to the view.

    Args:
        line: Socket from the supervisor; each message is one JSON object.
        telemetry: Of the run.
        view: View of the run.
    """

    def __init__(self, line: socket.socket, telemetry: Telemetry, view: View) -> None:
        self._line = line
        self._words = telemetry.words
        self._view = view
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

    def close(self) -> None:
        """Close the socket."""
        self._line.close()

    def _show(self, news: dict[str, Any]) -> None:
        view, origin_ns = self._view, self._words[Word.BEGAN_NS]
        if "note" in news and origin_ns:
            at_ns = news["at_ns"] - self._words[Word.OFFSET_NS]
            view.add([Mark((at_ns - origin_ns) * 1e-9, "note", news["note"])])
        elif "ended" in news:
            view.end(f"the run is over: {news['ended']}")
        elif "change" in news:
            change = news["change"]
            if change["outcome"] == "applied":
                with contextlib.suppress(HapticWallError):
                    view.change(changed(view.config, change["set"]), change["at_s"])
            if change["at_s"] is not None:
                view.add([change_mark(change)])


def view_of(orders: Mapping[str, Any]) -> tuple[View, News, Telemetry]:
    """Return the view of a running wall, its news, and its rows.

    Args:
        orders: Of the run's supervisor; the view takes the descriptors in them.
    """
    telemetry = Telemetry(orders["telemetry"])
    config = Config.model_validate_json(orders["config"], context=RUNS)
    view = View(
        config,
        orders["name"],
        RunningSource(telemetry, config.period_ns),
        recorded=False,
        hand=None if orders["hand"] is None else SharedHand(orders["hand"]),
        dead_man=DeadMan(telemetry.words) if orders["dead_man"] else None,
        now_ns=lambda: time.monotonic_ns() - telemetry.words[Word.OFFSET_NS],
    )
    return view, News(socket.socket(fileno=orders["news"]), telemetry, view), telemetry
