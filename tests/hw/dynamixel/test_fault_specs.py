"""A SPEC is read as a fault; one that is no fault is refused with a reason."""

import re
from pathlib import Path

import pytest

from haptic_wall.hw.emulated.faults import KEYS, KINDS, parse_fault


@pytest.mark.parametrize("name", KINDS)
def test_every_example_is_a_fault(name: str) -> None:
    assert parse_fault(KINDS[name].example).name == name


def test_values_have_their_units() -> None:
    fault = parse_fault(" jump:counts=-500, at=2.5,for=0.001 ")
    assert fault.values["counts"] == -500
    times = [fault.time_ns(key) for key in ("at", "for", "repeat")]
    assert times == [2_500_000_000, 1_000_000, None]
    assert parse_fault("hardware-error:bits=overload+voltage").values["bits"] == 0x21


@pytest.mark.parametrize(
    ("spec", "words"),
    [
        ("", ["''", "known are drop, corrupt"]),
        ("drop:q=0.1", ["drop has no 'q'", "known are p, every", "drop:p=0.01"]),
        ("drop:evry=3", ["'evry'", "did you mean every?"]),
        ("drop:p=2", ["drop: p", "'2'", "from 0 up to 1"]),
        ("drop:p=x", ["'x'", "a number"]),
        ("drop:every=0", ["every", "'0'", "whole number from 1"]),
        ("drop:p=0.1,p=0.2", ["p is given twice"]),
        ("drop:p=0.1,every=3", ["found both p and every"]),
        ("drop:way=up", ["way", "'up'", "request, reply, both"]),
        ("late:p=0.1", ["wanted ms", "late:ms=3,p=0.01"]),
        ("hardware-error:bits=fire", ["bits", "'fire'", "overheating"]),
        ("supply:volts=0", ["volts", "'0'", "from 0.1 up to 60"]),
        ("unplug:for=1,repeat=0.5", ["repeat=0.5", "for=1"]),
        ("brown-out:times=3", ["repeat=S"]),
        ("wrong-id:to=253", ["to", "252"]),
    ],
)
def test_a_wrong_one_is_answered_with_one_clear_sentence(spec: str, words: list[str]) -> None:
    with pytest.raises(ValueError) as refused:
        parse_fault(spec)
    message = str(refused.value)
    assert "\n" not in message
    for word in words:
        assert word in message


def test_the_page_lists_every_fault_as_it_is_asked_for() -> None:
    page = (Path(__file__).parents[3] / "docs" / "how-to" / "emulated-bus.md").read_text()
    rows = re.findall(r"^\| ?`([a-z-]+:[^`]*)` ?\|", page, re.M)
    assert sorted(rows) == sorted(kind.example for kind in KINDS.values())
    assert all(f"`{key}" in page or f"{key}=" in page for key in KEYS)
