"""The dead man's key, on the kernel's answers and times."""

from __future__ import annotations

import errno
import math
import os
from pathlib import Path

import pytest

from haptic_wall.controller.errors import UserError
from haptic_wall.controller.processes.hold import KEY_NS, LOOK_NS, key_reader, opened
from haptic_wall.controller.runtime.telemetry import Telemetry, Word

MS = 1_000_000
SPACE = 57
KEYS, STATE = 0x80604521, 0x80604518


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
    os.mkfifo("fifo")
    with pytest.raises(UserError) as refused:
        opened(text)
    assert str(refused.value).startswith("--hold: ")
    assert told in str(refused.value)


@pytest.fixture
def kernel(monkeypatch: pytest.MonkeyPatch) -> dict[int, set[int] | None]:
    """Codes that an input device, which is /dev/null here, answers by request; None: it is gone."""
    answers: dict[int, set[int] | None] = {KEYS: {SPACE}, STATE: set()}

    def ioctl(_: int, request: int, buffer: bytearray) -> int:
        codes = answers[request]
        if codes is None:
            raise OSError(errno.ENODEV, os.strerror(errno.ENODEV))
        for code in codes:
            buffer[code // 8] |= 1 << code % 8
        return 0

    monkeypatch.setattr("fcntl.ioctl", ioctl)
    return answers


def test_an_input_device_is_known_by_its_answers(kernel: dict[int, set[int] | None]) -> None:
    os.close(opened("/dev/null"))
    kernel[KEYS] = set()
    with pytest.raises(UserError, match="/dev/null is not an input device with keys"):
        opened("/dev/null")


def test_the_loop_looks_every_10_ms_and_a_device_that_is_gone_releases_for_good(
    kernel: dict[int, set[int] | None],
) -> None:
    words, told = Telemetry.create().words, list[OSError]()
    look = key_reader(0, words, told.append)
    assert (look(5 * MS), words[Word.HELD_NS]) == (5 * MS + LOOK_NS, 0)
    kernel[STATE] = {SPACE}
    assert (look(15 * MS), words[Word.HELD_NS]) == (15 * MS + LOOK_NS, 15 * MS + KEY_NS)
    kernel[STATE] = {700}
    assert (look(25 * MS), words[Word.HELD_NS]) == (25 * MS + LOOK_NS, 25 * MS + KEY_NS)
    kernel[STATE] = set()
    assert (look(35 * MS), words[Word.HELD_NS]) == (35 * MS + LOOK_NS, 0)
    kernel[STATE] = None
    assert (look(45 * MS), words[Word.HELD_NS]) == (math.inf, 0)
    assert [str(error) for error in told] == ["[Errno 19] No such device"]
