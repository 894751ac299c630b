"""Logs whose content no run has written, and commands that read them in this process."""

from __future__ import annotations

import contextlib
import copy
import io
import traceback
import warnings
from pathlib import Path
from random import Random
from typing import Any, NamedTuple, cast

import numpy as np
from numpy.typing import NDArray

from haptic_wall.controller.cli.main import main
from haptic_wall.controller.laws.table import EXAMPLES
from haptic_wall.controller.live.client import Client, Messages
from haptic_wall.controller.live.server import LiveServer
from haptic_wall.controller.runtime.telemetry import FLAG_CONTACT, ROW
from haptic_wall.controller.settings.load import load_config
from haptic_wall.controller.system.printable import printable

ODD: tuple[Any, ...] = (
    None, True, [], {}, "", "text", 0, -1, 99, 5.5, 1e308, 10**30, 10**400, [1, 2], {"a": None},
    "\x1b]0;owned\x07\x1b[2J\x9b31m", "\u202egnp.exe", "\ud800", "a\nended as planned", "$\\frac{$",
    "x" * 5000, [[]] * 1000, {"\x1b[31m": "\x07"}, "../../etc/passwd", "中 é",
)  # fmt: skip
"""Values that may stand anywhere in JSON"""
BY = {"pid": 7, "uid": 0, "user": "me"}
EVENTS: tuple[dict[str, Any], ...] = (
    {"at_s": 0.05, "row": 50, "outcome": "applied", "why": None, "set": ["wall.stiffness=9"],
     "changed": {"wall.stiffness": 9.0}, "waited_s": 0.01,
     "commanded": {"stiffness": 9.0, "damping": 0.02}, "by": BY},
    {"at_s": 0.1, "row": None, "outcome": "refused", "why": "unknown", "set": ["wall.x=1"],
     "changed": None, "waited_s": None, "commanded": None, "by": BY},
    {"at_s": 0.15, "row": 150, "outcome": "applied", "why": None, "set": [], "waited_s": 0.0,
     "changed": {"wall.law": "detents", "wall.count": 24, "delay.steps": 2}, "by": BY},
)  # fmt: skip
"""Changes of the running wall, as a run writes them"""
END: dict[str, Any] = {
    "stop_reason": "trip:overspeed", "message": "too fast", "ticks": 300, "missed": 0, "rows": 300,
    "changes": [EVENTS[0]],
    "servo": {"counts_per_rev": 4096, "torque_step": 0.005, "torque_limit": 4.1, "stall_torque": 4},
}  # fmt: skip
"""The end of a run, as it writes it"""
NAMES = (
    *EXAMPLES,
    "no:Law", "applied", "simulated", "dynamixel", "off", "passive", "both", "start", "notch",
)  # fmt: skip
"""Texts that have a meaning somewhere"""


def rows(count: int, start: int = 0, hand: float = 0.0) -> NDArray[np.void]:
    """A hand that goes in and out of a wall; no two rows are alike."""
    made = np.zeros(count, ROW)
    seq = np.arange(start, start + count)
    made["seq"], made["deadline_ns"] = seq, 3 * 10**9 + 10**6 * seq
    swing = 0.1 * np.sin(seq / 40.0 + hand)
    made["position"] = np.round(swing * 4096 / np.pi) * np.pi / 4096
    made["flags"] = np.where(made["position"] > 0.0, FLAG_CONTACT, 0)
    made["torque"] = made["wall_torque"] = np.where(swing > 0.0, -8.0 * swing, 0.0)
    made["stiffness"], made["damping"], made["delay_s"] = 8.0, 0.02, 3e-4
    made["lateness_ns"] = 1000 + seq + round(1e7 * hand)
    made["measured_torque"] = np.nan
    return made


def metadata(preset: str = "simulated", **changed: object) -> dict[str, object]:
    """Metadata that a log begins with."""
    config = load_config(preset).config.model_dump(mode="json")
    head = {"program": "haptic-wall", "name": preset, "config": config}
    return {**head, **changed}


def _odd(random: Random, *others: float) -> object:
    return copy.deepcopy(random.choice((*ODD, *others)))


def _mutate(random: Random, tree: Any) -> None:
    """Change the structure of JSON somewhere below its root, in place."""
    parent, key = tree, None
    while isinstance(parent, dict | list) and parent:
        keys = list(parent) if isinstance(parent, dict) else range(len(parent))
        key = random.choice(keys)
        inner = parent[key]
        if not (isinstance(inner, dict | list) and inner) or random.random() < 0.15:
            break
        parent = inner
    held = parent[key]
    match random.choice((0, 1, 2, 3, 4, 5, 5, 5, 6, 6, 6)):
        case 0:
            del parent[key]
        case 1:
            parent[key] = random.choice(([held], {"a": held}, [held] * 3, {key: held}))
        case 2:
            parent[key] = type(held)()
        case 3:
            parent[key] = random.choice(NAMES)
        case 4:
            other = random.choice(list(parent) if isinstance(parent, dict) else range(len(parent)))
            parent[key], parent[other] = parent[other], held
        case 5:
            size = random.choice((10.0 ** random.randint(-12, 12), 5e-324, 1e-300, 1e6, 0.0))
            parent[key] = random.choice((1, 1, 1, -1)) * size
        case _:
            parent[key] = _odd(random)


def story(random: Random) -> dict[str, Any]:
    """Return ``metadata``, ``events`` and ``end`` of a log, with a few changes of structure."""
    preset = random.choice(("simulated", "simulated", "xm430-w350", "emulated-ideal", "lwr3"))
    told: dict[str, Any] = copy.deepcopy(
        {"metadata": metadata(preset), "events": [*EVENTS], "end": END}
    )
    root = random.choice((told["metadata"]["config"], told["events"], told["end"]))
    for _ in range(random.choice((1, 1, 1, 2, 4))):
        if root:
            _mutate(random, root)
    return told


class Answer(NamedTuple):
    """Result of a command."""

    status: int
    out: str
    err: str
    fault: str
    """What no command may do; empty: nothing of it"""


def called(*words: str | Path) -> Answer:
    """Run a command in this process: it has a result, or refuses in one sentence."""
    out, err = (io.TextIOWrapper(io.BytesIO(), "utf-8") for _ in range(2))
    status, fault = 1, ""
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        try:
            with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
                status = main([str(word) for word in words])
        except SystemExit as ended:
            status = ended.code if isinstance(ended.code, int) else 1
        except Exception:  # noqa: BLE001 - which is what is looked for
            fault = "".join(traceback.format_exc()[-1000:])
    texts = []
    for stream in (out, err):
        stream.flush()
        texts.append(stream.buffer.getvalue().decode("utf-8", "replace"))
    said = "".join(texts)
    if not fault and (status not in (0, 2, 4) or "Traceback" in said):
        fault = f"status {status}: {said[-300:]}"
    elif said != printable(said):
        fault = f"to the terminal: {said[:300]!a}"
    elif status and not texts[1].strip():
        fault = "refused without a word"
    return Answer(status, texts[0], texts[1], fault)


class _Page(Client):
    """A page that reads everything at once."""

    def __init__(self) -> None:
        super().__init__(cast("Any", None), 0, turns=False)

    def serve(self, new: Messages, _beat: int | None = None, *, last: bool = False) -> None:  # noqa: ARG002
        self._texts.clear()
        self.tail = new.since(self.tail)[1]


async def one_turn(server: LiveServer, *_: object) -> None:
    """Take the place of ``LiveServer.run``: one page, one message of each kind, and no socket."""
    view = server._view
    view.welcome(_Page(), controls=False)
    await server.pump(lambda: True)
    await view.draw_map()
