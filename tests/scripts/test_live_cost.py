"""The study of the live page's cost: what it counts, and that it finds what is too much."""

from __future__ import annotations

import math
import socket
import threading
from dataclasses import replace

import numpy as np
import pytest

from scripts import page_and_loop
from scripts.live_clients import client
from scripts.page_and_loop import (
    AGAIN,
    BASE,
    FIGURES,
    MODES,
    Case,
    Cost,
    EndedError,
    beyond,
    cheap,
    cost,
    cost_lines,
    middle,
    turns,
)
from scripts.page_times import ages_ms
from scripts.studies.live_cost import STUDY
from scripts.study import usual


def rounds(times: dict[str, float], again: float = 1.0) -> list[tuple[Case, Cost]]:
    """Seven rounds in which each mode is so many times worse than without a page."""
    factors = {BASE: 1.0, AGAIN: again, **times}
    return [
        (Case("simulated", mode, turn, 7.0), Cost(*(factors.get(mode, 1.0) * (turn + 1.0),) * 4))
        for turn in range(7)
        for mode in MODES
    ]


def test_a_page_that_costs_too_much_is_named() -> None:
    assert cheap(rounds({}))
    assert "It holds." in cost_lines(rounds({}))[-1]
    costly = rounds({"20 clients": 1.2})
    assert not cheap(costly)
    assert beyond(costly) == [f"20 clients, {words}" for words in FIGURES.values()]
    assert "1.20 (1.20 to 1.20)" in "\n".join(cost_lines(costly))
    assert "20 clients, lateness, p50" in cost_lines(costly)[-1]


def test_a_run_that_ended_early_is_repeated_and_counted(monkeypatch: pytest.MonkeyPatch) -> None:
    case, row = rounds({})[0]
    tried: list[Case] = []

    def unlucky(case: Case) -> Cost:
        tried.append(case)
        if len(tried) < 3:
            raise EndedError("a trip")
        return row

    monkeypatch.setattr(page_and_loop, "_cost", unlucky)
    found = rounds({})
    assert "repeated" not in cost_lines(found)[-1]
    assert cost_lines([(case, cost(case)), *found[1:]])[-1].endswith("repeated: no page, 2.")


def test_a_ratio_that_the_rounds_do_not_decide_is_named_with_its_doubt() -> None:
    found = [
        (case, replace(row, late_p50=row.late_p50 * (0.8 if case.turn < 3 else 1.3)))
        if case.mode == "one client"
        else (case, row)
        for case, row in rounds({})
    ]
    assert cheap(found)
    assert beyond(found) == ["one client, lateness, p50 (undecided)"]


def test_the_bounds_of_a_median_are_those_of_the_order() -> None:
    """Of 20 values the sixth and the fifteenth: the median lies outside in 4.1 %."""
    assert middle([*range(20, 0, -1)]) == (10.5, 6, 15)
    assert middle([3.0, 1.0, 2.0]) == (2.0, 1.0, 3.0)


def test_every_mode_comes_first_in_some_round() -> None:
    cases = turns(usual(STUDY, rounds=len(MODES)), "simulated")
    assert {case.mode for case in cases[:: len(MODES)]} == set(MODES)
    assert len(set(cases)) == len(cases) == len(MODES) ** 2


def test_a_row_ages_until_the_first_picture_that_has_it() -> None:
    """Pictures every 20 ms, drawn 5 ms after their newest row: ages from 5 to 25 ms."""
    newest = np.array([1.0, 1.02, 1.04])
    ages = ages_ms(newest, newest + 0.005)
    assert len(ages) == 40
    assert ages.min() == pytest.approx(5.0)
    assert np.median(ages) == pytest.approx(14.5)
    assert len(ages_ms(newest, np.array([0.0, math.nan, 1.05]))) == 20
    assert not len(ages_ms(newest, np.full(3, math.nan)))


def test_a_refused_client_is_no_client() -> None:
    with socket.create_server(("127.0.0.1", 0)) as server:

        def refuse() -> None:
            link, _ = server.accept()
            with link:
                link.recv(4096)
                link.sendall(b"HTTP/1.1 403 Forbidden\r\n\r\n")

        thread = threading.Thread(target=refuse)
        thread.start()
        with pytest.raises(ConnectionError, match="403"):
            client(f"http://127.0.0.1:{server.getsockname()[1]}/")
        thread.join()
