"""The dead man's sources, on bytes and times; and its watcher, as a process."""

from __future__ import annotations

import array
import os
import pty
import time
from collections.abc import Callable
from pathlib import Path

import pytest

from haptic_wall.controller.errors import UserError
from haptic_wall.controller.processes.children import Child
from haptic_wall.controller.processes.hold import (
    EVENT,
    KEY_NS,
    SILENCE_NS,
    FileSource,
    Hold,
    KeySource,
    hold_by,
    source_of,
)
from haptic_wall.controller.processes.hold_watcher import watch
from haptic_wall.controller.runtime.telemetry import Telemetry, Word

MS = 1_000_000
SPACE, ENTER = 57, 28


def event(code: int, value: int, kind: int = 1) -> bytes:
    return EVENT.pack(0, 0, kind, code, value)


class Stream:
    """A device's stream of events, without the device."""

    def __init__(self, key: int | None = None) -> None:
        self.out, self.end = os.pipe()
        self.source = KeySource(self.out, key)

    def send(self, *events: bytes) -> Stream:
        os.write(self.end, b"".join(events))
        return self

    def held(self) -> bool:
        until = self.source.until(1000 * MS, 0)
        assert until in (0, 1000 * MS + KEY_NS)
        return until > 0


def test_the_events_are_as_long_as_the_kernels() -> None:
    assert EVENT.size == 24 or os.uname().machine not in ("x86_64", "aarch64")


def test_a_key_is_held_from_its_press_to_its_release() -> None:
    stream = Stream()
    assert not stream.held()
    assert stream.send(event(SPACE, 1), event(0, 0, 0)).held()
    assert stream.held(), "no news is no release"
    assert stream.send(event(SPACE, 2)).held(), "it repeats"
    assert not stream.send(event(SPACE, 0)).held()


def test_a_key_that_is_named_is_the_only_one_that_counts() -> None:
    stream = Stream(SPACE)
    assert not stream.send(event(ENTER, 1)).held()
    assert stream.send(event(SPACE, 1)).held()
    assert stream.send(event(ENTER, 0)).held()
    assert not stream.send(event(SPACE, 0)).held()


def test_of_several_keys_the_last_one_holds() -> None:
    stream = Stream().send(event(SPACE, 1), event(ENTER, 1))
    assert stream.send(event(SPACE, 0)).held()
    assert not stream.send(event(ENTER, 0)).held()


def test_other_events_are_no_keys() -> None:
    """Motion of a mouse (2), a switch (5): their codes and values are others."""
    assert not Stream().send(event(SPACE, 1, kind=2), event(SPACE, 1, kind=5)).held()


def test_an_event_may_come_in_two_parts() -> None:
    whole = event(SPACE, 1)
    stream = Stream().send(whole[:10])
    assert not stream.held()
    assert stream.send(whole[10:]).held()


def test_lost_events_release_what_the_kernel_does_not_call_held() -> None:
    stream = Stream().send(event(SPACE, 1))
    assert stream.held()
    assert not stream.send(event(3, 0, kind=0)).held(), "a pipe knows of no key"


def test_a_device_that_is_gone_is_an_error() -> None:
    stream = Stream().send(event(SPACE, 1))
    os.close(stream.end)
    with pytest.raises(OSError, match="No such device"):
        stream.held()


def renew(path: Path, wall_ns: int) -> None:
    """Write to the file; its time stamp is ``wall_ns``."""
    path.write_text("x")
    os.utime(path, ns=(wall_ns, wall_ns))


def test_a_file_that_exists_is_not_enough(tmp_path: Path) -> None:
    path = tmp_path / "hold"
    renew(path, 500 * MS)
    source = FileSource(str(path), 0)
    for k in range(1, 50):
        assert source.until(10 * k * MS, 500 * MS + 10 * k * MS) == 0


def test_a_renewal_holds_for_150_ms_from_its_stamp(tmp_path: Path) -> None:
    path = tmp_path / "hold"
    path.touch()
    source = FileSource(str(path), 0)
    renew(path, 1004 * MS)
    assert source.until(10 * MS, 1010 * MS) == 4 * MS + SILENCE_NS
    assert source.until(20 * MS, 1020 * MS) == 4 * MS + SILENCE_NS
    renew(path, 1100 * MS)
    assert source.until(100 * MS, 1100 * MS) == 100 * MS + SILENCE_NS


@pytest.mark.parametrize("stamp", [0, 5000], ids=["long ago", "in the future"])
def test_a_stamp_that_cannot_be_true_counts_within_the_last_look(
    tmp_path: Path, stamp: int
) -> None:
    path = tmp_path / "hold"
    path.touch()
    source = FileSource(str(path), 0)
    source.until(90 * MS, 1090 * MS)
    renew(path, stamp * MS)
    assert 90 * MS <= source.until(100 * MS, 1100 * MS) - SILENCE_NS <= 100 * MS


def test_a_file_that_is_replaced_is_renewed_and_one_that_is_gone_is_not(tmp_path: Path) -> None:
    path, other = tmp_path / "hold", tmp_path / "other"
    renew(path, 1000 * MS)
    source = FileSource(str(path), 0)
    renew(other, 1000 * MS)
    other.rename(path)
    assert source.until(10 * MS, 1010 * MS) == SILENCE_NS
    path.unlink()
    assert source.until(20 * MS, 1020 * MS) == SILENCE_NS


def test_a_folder_in_the_place_of_the_file_renews_nothing(tmp_path: Path) -> None:
    path = tmp_path / "hold"
    renew(path, 1000 * MS)
    source = FileSource(str(path), 0)
    path.unlink()
    path.mkdir()
    for k in range(1, 4):
        os.utime(path, ns=(1000 * MS, (1000 + 10 * k) * MS))
        assert source.until(10 * k * MS, (1000 + 10 * k) * MS) == 0


def test_what_can_be_held_is_found_out_before_the_start(tmp_path: Path) -> None:
    file = tmp_path / "a:b"
    file.touch()
    assert hold_by(str(file)) == Hold(str(file), "file")
    assert source_of(hold_by(str(file)), None, 0).until(1, 1) == 0


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("nowhere", "nowhere cannot be opened (No such file or directory)"),
        ("/dev/null", "neither an input device nor a file"),
        (".", "neither an input device nor a file"),
        ("fifo", "neither an input device nor a file"),
        ("file:KEY_SPACE", "is a file and has no keys"),
        ("file:KEY_NONE", "found the key 'KEY_NONE', wanted its code as a number"),
        ("file:768", "found the key '768'"),
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
    answers = {0x80044501: set(), 0x80604521: {SPACE, ENTER}, 0x80604518: {SPACE}}

    def ioctl(_: int, request: int, buffer: bytearray | array.array[int]) -> int:
        codes = answers[request]
        for code in codes:
            buffer[code // 8] |= 1 << code % 8
        return 0

    monkeypatch.setattr("fcntl.ioctl", ioctl)
    return answers


def test_an_input_device_is_known_by_its_answers(kernel: dict[int, set[int]]) -> None:
    assert hold_by("/dev/null") == Hold("/dev/null", "key", None)
    assert hold_by("/dev/null:key_space") == Hold("/dev/null", "key", SPACE)
    assert hold_by("/dev/null:28") == Hold("/dev/null", "key", ENTER)
    with pytest.raises(UserError, match="the device /dev/null has no key 30; name another"):
        hold_by("/dev/null:KEY_A")
    kernel[0x80604521] = set()
    with pytest.raises(UserError, match="has no key; name another device"):
        hold_by("/dev/null")


@pytest.mark.parametrize(("key", "held"), [(None, True), (SPACE, True), (ENTER, False)])
@pytest.mark.usefixtures("kernel")
def test_a_key_that_is_down_at_the_start_is_held(key: int | None, held: bool) -> None:
    assert Stream(key).held() is held


def test_after_lost_events_the_kernel_is_asked_what_is_down(kernel: dict[int, set[int]]) -> None:
    kernel[0x80604518] = set()
    stream = Stream()
    assert not stream.held()
    kernel[0x80604518] = {ENTER}
    lost = event(3, 0, kind=0)
    assert stream.send(event(SPACE, 1), lost).held()
    assert not stream.send(event(ENTER, 0)).held(), "the other is up, whatever was lost"


def test_a_terminal_is_refused_by_name() -> None:
    _, terminal = pty.openpty()
    with pytest.raises(UserError, match="does not report the release of a key"):
        hold_by(os.ttyname(terminal))


def test_a_watcher_whose_source_is_gone_releases_for_good() -> None:
    stream = Stream().send(event(SPACE, 1))
    os.close(stream.end)
    words = Telemetry.create().words
    words[Word.HELD_NS] = 2**62
    assert watch(stream.source, words).errno
    assert words[Word.HELD_NS] == 0


def wait_for(condition: Callable[..., object]) -> None:
    end = time.monotonic() + 30.0
    while time.monotonic() < end:
        if condition():
            return
        time.sleep(0.002)
    raise AssertionError("it did not happen")


@pytest.mark.realtime
def test_the_watchers_process_holds_releases_and_is_silent_when_killed() -> None:
    telemetry, (out, end) = Telemetry.create(), os.pipe()
    telemetry.words[Word.HELD_NS] = 0
    orders = {
        "telemetry": telemetry.descriptor,
        "parent": os.getpid(),
        "hold": {"path": "a pedal", "kind": "key", "key": None},
        "descriptor": out,
        "real_time": False,
    }
    module = ["haptic_wall.controller.processes.hold_watcher"]
    watcher = Child("watcher", module, orders, [telemetry.descriptor, out])
    words = telemetry.words
    try:
        os.write(end, event(SPACE, 1))
        wait_for(lambda: words[Word.HELD_NS] > time.monotonic_ns())
        os.write(end, event(SPACE, 0))
        wait_for(lambda: words[Word.HELD_NS] == 0)
        os.write(end, event(SPACE, 1))
        wait_for(lambda: words[Word.HELD_NS] > time.monotonic_ns())
    finally:
        watcher.dismiss(0.0)
    assert words[Word.HELD_NS] <= time.monotonic_ns() + KEY_NS, "nobody is there to say more"
