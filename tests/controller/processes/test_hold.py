"""The dead man's key, on bytes and times."""

from __future__ import annotations

import array
import math
import os
from pathlib import Path

import pytest

from haptic_wall.controller.errors import UserError
from haptic_wall.controller.processes.hold import (
    EVENT,
    KEY_NS,
    LOOK_NS,
    Hold,
    KeySource,
    hold_by,
    key_reader,
)
from haptic_wall.controller.runtime.telemetry import Telemetry, Word

MS = 1_000_000
SPACE = 57


def event(code: int, value: int, kind: int = 1) -> bytes:
    return EVENT.pack(0, 0, kind, code, value)


class Stream:
    """A device's stream of events, without the device."""

    def __init__(self) -> None:
        self.out, self.end = os.pipe()
        self.source = KeySource(self.out)

    def send(self, *events: bytes) -> Stream:
        os.write(self.end, b"".join(events))
        return self

    def held(self) -> bool:
        until = self.source.until(1000 * MS)
        assert until in (0, 1000 * MS + KEY_NS)
        return until > 0


def test_a_key_is_held_from_its_press_to_its_release() -> None:
    stream = Stream()
    assert not stream.held()
    assert stream.send(event(SPACE, 1), event(0, 0, 0)).held()
    assert stream.held(), "no news is no release"
    assert stream.send(event(SPACE, 2)).held(), "it repeats"
    assert not stream.send(event(SPACE, 0)).held()


def test_lost_events_release_what_the_kernel_does_not_call_held() -> None:
    stream = Stream().send(event(SPACE, 1))
    assert stream.held()
    assert not stream.send(event(3, 0, kind=0)).held(), "a pipe knows of no key"


def test_a_device_that_is_gone_is_an_error() -> None:
    stream = Stream().send(event(SPACE, 1))
    os.close(stream.end)
    with pytest.raises(OSError, match="No such device"):
        stream.held()


@pytest.mark.parametrize(
    ("text", "told"),
    [
        (" ", "found nothing; name an input device"),
        ("nowhere", "nowhere cannot be opened (No such file or directory)"),
        ("/dev/null", "is not an input device"),
        (".", "is not an input device"),
        ("fifo", "is not an input device"),
        ("a\0b", "cannot be opened"),
    ],
)
def test_what_cannot_be_held_is_refused(
    text: str, told: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("file").touch()
    os.mkfifo("fifo")
    with pytest.raises(UserError) as refused:
        hold_by(text)
    assert str(refused.value).startswith("--hold: ")
    assert told in str(refused.value)


@pytest.fixture
def kernel(monkeypatch: pytest.MonkeyPatch) -> dict[int, set[int]]:
    """Answers of an input device by request: /dev/null, or a pipe, shall be one."""
    answers = {0x80044501: set(), 0x80604521: {SPACE}, 0x80604518: {SPACE}}

    def ioctl(_: int, request: int, buffer: bytearray | array.array[int]) -> int:
        codes = answers[request]
        for code in codes:
            buffer[code // 8] |= 1 << code % 8
        return 0

    monkeypatch.setattr("fcntl.ioctl", ioctl)
    return answers


def test_an_input_device_is_known_by_its_answers(kernel: dict[int, set[int]]) -> None:
    assert hold_by("/dev/null") == Hold("/dev/null")
    kernel[0x80604521] = set()
    with pytest.raises(UserError, match="has no key; name another device"):
        hold_by("/dev/null")


def test_the_loop_looks_every_10_ms_and_a_device_that_is_gone_releases_for_good() -> None:
    stream, words, told = Stream(), Telemetry.create().words, list[OSError]()
    look = key_reader(stream.source, words, told.append)
    assert (look(5 * MS), words[Word.HELD_NS]) == (5 * MS + LOOK_NS, 0)
    stream.send(event(SPACE, 1))
    assert (look(15 * MS), words[Word.HELD_NS]) == (15 * MS + LOOK_NS, 15 * MS + KEY_NS)
    os.close(stream.end)
    assert (look(25 * MS), words[Word.HELD_NS]) == (math.inf, 0)
    assert len(told) == 1
