"""What all pages see of a run: each law from its time on, the servo's health, the knobs."""

from __future__ import annotations

import itertools
import json
import socket
from types import SimpleNamespace
from typing import Any, cast

import numpy as np

from haptic_wall.controller.live.client import Client
from haptic_wall.controller.live.dead_man import SILENCE_NS, DeadMan
from haptic_wall.controller.live.relay import OFFERED, sets_of
from haptic_wall.controller.live.running_view import News
from haptic_wall.controller.live.source import LoggedSource, RunningSource
from haptic_wall.controller.live.view import View
from haptic_wall.controller.runtime.telemetry import FLAG_OFF, Telemetry, Word
from haptic_wall.controller.settings.changes import changed
from haptic_wall.controller.settings.load import load_config
from haptic_wall.hw.hand import SharedHand
from tests.support.rows import ORIGIN_NS, rows_of
from tests.typed import not_none

CONFIG = load_config("simulated", ()).config
ELSEWHERE = changed(CONFIG, ["wall.position=0.4"])
STOPS = changed(CONFIG, ["wall.law=stops", "wall.low=-0.5", "wall.high=0.3"])


class Page:
    """Keeps what a page is told."""

    def __init__(self) -> None:
        self.told: list[dict[str, Any]] = []

    def tell(self, what: dict[str, Any]) -> None:
        self.told.append(what)

    def last(self, kind: str) -> Any:
        return [each for each in self.told if each["kind"] == kind][-1]


def greeted(view: View) -> Page:
    page = Page()
    view.welcome(cast("Client", page), {"controls": True})
    return page


def test_hand_and_dead_man_are_on_the_clock_of_the_loop() -> None:
    """An elastic clock is behind the system's: a hand would hold on longer, or not at all."""
    telemetry, hand = Telemetry.create(), SharedHand.create()
    source, man = RunningSource(telemetry, 1_000_000), DeadMan(telemetry.words)
    telemetry.words[Word.HELD_NS] = 0
    view = View(CONFIG, "a", source, recorded=False, hand=hand, dead_man=man, now_ns=lambda: 5000)
    view.shaft = 0.1
    assert view.grasp(object(), {"position": 0.2, "stiffness": 1.0})
    assert not_none(hand.look(5000)).begin_ns == 5000
    assert view.hold(cast("Client", object()), 0)
    assert telemetry.words[Word.HELD_NS] == SILENCE_NS


def test_a_log_shows_each_law_from_its_row_on() -> None:
    rows = rows_of(100, 50)
    rows["stiffness"] = np.where(rows["seq"] < 100, 8.0, 4.0)
    log = SimpleNamespace(blocks=lambda: [rows[:30], rows[30:]], origin_ns=ORIGIN_NS)
    source = LoggedSource(cast("Any", log))
    view = View(CONFIG, "a", source, recorded=True)
    begun = source.since([0, 20, 100, 150])  # the last one is behind the stretch
    walls = (CONFIG, STOPS, ELSEWHERE)
    view.recall({}, [], [(*at, each) for at, each in zip(begun, walls, strict=True)])
    page = greeted(view)
    laws = page.last("laws")["laws"]
    assert [each["since"] for each in laws] == [0.05, 0.1]
    assert [each["name"] for each in laws] == ["stops", "wall"]
    slopes = [max(np.abs(np.diff(each["torque"]))) for each in laws]
    assert slopes[0] > 1.5 * slopes[1], "each with the stiffness of its time"
    assert page.last("wall")["wall"]["position"] == 0.4


def test_a_page_knows_the_travel_and_which_rows_have_no_wall() -> None:
    sets = ["safety.travel=[-2, 4]"]
    config = load_config("simulated", sets).config
    source = RunningSource(Telemetry.create(), 1_000_000)
    page = greeted(View(config, "a", source, recorded=False))
    assert page.last("wall")["travel"] == [-2.0, 4.0]
    assert page.last("hello")["off"] & FLAG_OFF


def test_each_law_can_be_chosen_from_each_and_its_numbers_turned() -> None:
    made = {
        law: changed(CONFIG, sets_of(choice(law)) or []) if law != "wall" else CONFIG
        for law in OFFERED
    }
    for before, after in itertools.permutations(made, 2):
        found = changed(made[before], sets_of(choice(after)) or [])
        assert (found.wall.law, found.request()) == (after, made[after].request())
    for law, config in made.items():
        for name in OFFERED[law].numbers:
            if (value := getattr(config.wall, name)) is not None:
                changed(config, sets_of({f"wall.{name}": value}) or [])
    assert sets_of({"wall.side": "below"}) == ['wall.side="below"']


def choice(law: str) -> dict[str, Any]:
    """What the page asks for to choose a law."""
    return {"wall.law": law} | {f"wall.{name}": each for name, each in OFFERED[law].example.items()}


def test_a_change_of_one_of_several_axes_shows_on_its_page() -> None:
    each = load_config("simulated", ["axes={elbow: {}, wrist: {}}"]).config.each
    telemetry, (ours, theirs) = Telemetry.create(2), socket.socketpair(type=socket.SOCK_SEQPACKET)
    views = {
        name: View(config, "a", RunningSource(telemetry, 1_000_000, index), recorded=False)
        for index, (name, config) in enumerate(each.items())
    }
    news = News(ours, telemetry, views)
    path = "axes.wrist.wall.stiffness"
    change = {"outcome": "applied", "set": [f"{path}=3"], "changed": {path: 3.0}, "at_s": None}
    with theirs:
        theirs.send(json.dumps({"change": change}).encode())
        news.take()
    ours.close()
    shown = {name: view.config.wall.stiffness for name, view in views.items()}
    assert shown == {"elbow": CONFIG.wall.stiffness, "wrist": 3.0}
