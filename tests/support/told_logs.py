"""Logs that no run has written, and a page that reads them."""

from __future__ import annotations

from typing import Any, cast

import numpy as np
from numpy.typing import NDArray

from haptic_wall.controller.live.client import Client
from haptic_wall.controller.live.server import LiveServer
from haptic_wall.controller.live.source import Source
from haptic_wall.controller.runtime.telemetry import FLAG_CONTACT
from haptic_wall.controller.settings.load import load_config
from tests.support.rows import rows_of

EVENTS: tuple[dict[str, Any], ...] = (
    {"at_s": 0.05, "row": 50, "outcome": "applied", "why": None, "set": ["wall.stiffness=9"],
     "changed": {"wall.stiffness": 9.0}, "waited_s": 0.01,
     "commanded": {"stiffness": 9.0, "damping": 0.02}},
    {"at_s": 0.1, "row": None, "outcome": "refused", "why": "unknown", "set": ["wall.x=1"],
     "changed": None, "waited_s": None, "commanded": None},
    {"at_s": 0.15, "row": 150, "outcome": "applied", "why": None, "set": [], "waited_s": 0.0,
     "changed": {"wall.law": "detents", "wall.count": 24, "delay.steps": 2}},
)  # fmt: skip
"""Changes of the running wall, as a run writes them"""


def rows(count: int, start: int = 0, hand: float = 0.0) -> NDArray[np.void]:
    """A hand that goes in and out of a wall; no two rows are alike."""
    made = rows_of(count, start, stiffness=8.0, damping=0.02, delay_s=3e-4)
    seq = made["seq"]
    swing = 0.1 * np.sin(seq / 40.0 + hand)
    made["position"] = np.round(swing * 4096 / np.pi) * np.pi / 4096
    made["flags"] = np.where(made["position"] > 0.0, FLAG_CONTACT, 0)
    made["torque"] = made["wall_torque"] = np.where(swing > 0.0, -8.0 * swing, 0.0)
    made["lateness_ns"] = 1000 + seq + round(1e7 * hand)
    made["measured_torque"] = np.nan
    return made


def metadata(preset: str = "simulated", *sets: str, **changed: object) -> dict[str, object]:
    """Metadata that a log begins with."""
    config = load_config(preset, sets).config.model_dump(mode="json")
    head = {"program": "haptic-wall", "name": preset, "config": config}
    return {**head, **changed}


class _Page(Client):
    """A page that reads everything at once."""

    def __init__(self) -> None:
        super().__init__(cast("Any", None), turns=False)

    def serve(self, source: Source, _beat: int | None = None, *, last: bool = False) -> None:  # noqa: ARG002
        self._texts.clear()
        self.rows(source)


async def one_turn(server: LiveServer, *_: object) -> None:
    """Take the place of ``LiveServer.run``: a page of each axis, each message, and no socket."""
    for view in server.views.values():
        view.welcome(_Page(), {"controls": False})
    await server.pump(lambda: True)
    for view in server.views.values():
        await view.draw_map()
