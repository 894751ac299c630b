"""A log keeps what was written, byte for byte, whatever becomes of the disk or the writer."""

import errno
import io
import os
from pathlib import Path
from typing import Any, NoReturn

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from haptic_wall.controller.errors import LogFormatError
from haptic_wall.controller.logs.file import LogWriter, append_end, read_log
from haptic_wall.controller.logs.reader import Damage, End, LogReader
from haptic_wall.controller.system.file_kinds import LOG
from haptic_wall.controller.system.whole_file import Beside

ROW = np.dtype([("seq", "<i8"), ("position", "<f8")])
METADATA = {"name": "simulated", "config": {"wall": {"stiffness": 8.0}}, "unit": "N·m"}


def rows(count: int, start: int = 0) -> NDArray[np.void]:
    block = np.zeros(count, ROW)
    number = np.arange(start, start + count)
    block["seq"], block["position"] = number, 0.1 * number
    return block


def write(path: Path, *blocks: NDArray[np.void]) -> Path:
    with LogWriter(path, METADATA, ROW) as log:
        for block in blocks:
            log.append(block)
    return path


def test_what_was_written_is_read(tmp_path: Path) -> None:
    metadata, read = read_log(write(tmp_path / "a.hwlog", rows(3), rows(0), rows(4, 3)))
    assert {**METADATA, **metadata} == metadata
    np.testing.assert_array_equal(read, rows(7))


def pieces(path: Path) -> tuple[list[int], list[Damage], list[dict[str, Any]]]:
    """The rows' numbers, the damage, and the ends that a log gives."""
    numbers: list[int] = []
    damage: list[Damage] = []
    ends: list[dict[str, Any]] = []
    for piece in LogReader(path).pieces():
        if isinstance(piece, Damage):
            damage.append(piece)
        elif isinstance(piece, End):
            ends.append(piece.ended)
        else:
            assert isinstance(piece, np.ndarray)
            np.testing.assert_array_equal(piece["position"], 0.1 * piece["seq"])
            numbers += piece["seq"].tolist()
    return numbers, damage, ends


@pytest.fixture(scope="module")
def blocks(tmp_path_factory: pytest.TempPathFactory) -> tuple[bytes, list[tuple[range, int, int]]]:
    """A log's bytes, and for each of its blocks the row numbers, the first byte and the end."""
    path = tmp_path_factory.mktemp("log") / "a.hwlog"
    table, start = [], 0
    with LogWriter(path, METADATA, ROW) as log:
        begin = path.stat().st_size
        for count in (40, 3, 300, 1, 90, 256, 17):
            log.append(rows(count, start))
            end = path.stat().st_size
            table.append((range(start, start + count), begin, end))
            start, begin = start + count, end
    return path.read_bytes(), table


def damaged(data: st.DataObject, content: bytes) -> tuple[bytes, list[tuple[int, int]]]:
    """The content as a failing disk or a power cut may leave it, and the bytes that were hit."""
    size = len(content)
    kind = data.draw(st.sampled_from(["bytes", "zeros", "page", "noise", "cut", "tail"]))
    start = data.draw(st.integers(0, size - 1))
    if kind == "cut":
        return content[:start], [(start, size)]
    if kind == "tail":  # the file's length was kept, not what is in it
        return content[:start] + bytes(size - start), [(start, size)]
    if kind == "page":
        start -= start % 4096
    length = {"bytes": 1, "page": 4096}.get(kind) or data.draw(st.integers(1, 6000))
    end = min(size, start + length)
    hit = np.frombuffer(content[start:end], np.uint8)
    if kind in ("zeros", "page"):
        other = np.zeros_like(hit)
    else:
        noise = np.random.default_rng(data.draw(st.integers(0, 9))).integers(1, 256, hit.size)
        other = (hit ^ noise).astype(np.uint8)
    changed = np.flatnonzero(other != hit) + start
    spans = [(int(changed[0]), int(changed[-1]) + 1)] if changed.size else []
    return content[:start] + other.astype(np.uint8).tobytes() + content[end:], spans


def touched(begin: int, end: int, content: bytes, now: bytes) -> bool:
    return content[begin:end] != now[begin:end]


def test_every_intact_block_is_given_back_and_nothing_false(
    blocks: tuple[bytes, list[tuple[range, int, int]]], tmp_path: Path, thorough: bool
) -> None:
    content, table = blocks
    path = tmp_path / "a.hwlog"
    metadata_end = table[0][1]

    @settings(max_examples=10_000 if thorough else 100)
    @given(st.data())
    def check(data: st.DataObject) -> None:
        now, hits = content, []
        for _ in range(data.draw(st.integers(1, 3))):
            if len(now) > 1:
                now, spans = damaged(data, now)
                hits += spans
        path.write_bytes(now)
        intact = [numbers for numbers, begin, end in table if not touched(begin, end, content, now)]
        if not intact and touched(0, metadata_end, content, now):
            with pytest.raises(LogFormatError):
                LogReader(path)
            return
        numbers, damage, _ = pieces(path)
        assert numbers == [n for block in intact for n in block]
        skipped = sum(piece.size for piece in damage)
        lost = sum(end - begin for n, begin, end in table if n not in intact)
        lost -= len(content) - len(now)
        if not touched(0, metadata_end, content, now):
            assert LogReader(path).metadata["unit"] == "N·m"
            assert skipped == max(0, lost)
        else:
            assert LogReader(path).metadata == {}

    check()


def test_a_log_ends_with_how_the_run_ended(tmp_path: Path) -> None:
    path = write(tmp_path / "a.hwlog", rows(3))
    append_end(path, {"stop_reason": "trip:overspeed"})
    assert pieces(path) == ([0, 1, 2], [], [{"stop_reason": "trip:overspeed"}])
    assert len(read_log(path)[1]) == 3
    append_end(tmp_path / "none.hwlog", {"stop_reason": "duration"})
    assert not (tmp_path / "none.hwlog").exists()


def test_what_a_killed_writer_left_does_not_hide_the_end(tmp_path: Path) -> None:
    path = write(tmp_path / "a.hwlog", rows(3), rows(3, 3))
    path.write_bytes(path.read_bytes()[:-10])
    append_end(path, {"stop_reason": "duration"})
    numbers, damage, ends = pieces(path)
    assert (numbers, ends) == ([0, 1, 2], [{"stop_reason": "duration"}])
    assert [piece.last for piece in damage] == [False]


def test_what_the_disk_has_lost_is_an_error_once(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def lose(_: object) -> NoReturn:
        raise OSError(errno.EIO, "Input/output error")

    with LogWriter(tmp_path / "a.hwlog", METADATA, ROW) as log:
        with monkeypatch.context() as once:
            once.setattr(os, "fdatasync", lose)
            with pytest.raises(OSError, match="Input/output"):
                log.sync()
        log.append(rows(3))
        log.sync()


class _FullDisk(io.FileIO):
    """A disk that takes ``room`` more bytes, a few at a time."""

    room = 0

    def write(self, data: Any) -> int:
        taken = min(len(data), self.room, 100)
        if taken == 0:
            raise OSError(errno.ENOSPC, "No space left on device")
        self.room -= taken
        return super().write(bytes(data[:taken]))


def test_a_full_disk_costs_only_what_did_not_fit(tmp_path: Path) -> None:
    path = tmp_path / "a.hwlog"
    log = LogWriter(path, METADATA, ROW)
    log._file.close()
    log._file = disk = _FullDisk(path, "r+")
    disk.seek(0, io.SEEK_END)
    disk.room = 700
    log.append(rows(10))
    with pytest.raises(OSError, match="No space left") as full:
        log.append(rows(100, 10))
    assert full.value.errno == errno.ENOSPC
    np.testing.assert_array_equal(read_log(path)[1], rows(10))
    disk.room = 10_000
    log.append(rows(100, 10))
    log.close()
    np.testing.assert_array_equal(read_log(path)[1], rows(110))


@pytest.mark.parametrize(
    "content",
    [b"", b"time_s,position_rad\n0,0\n", b"\x93NUMPY", b"\x93NUMPY\x01\x00v\x00" + b"x" * 118],
)
def test_another_file_is_not_a_log(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / "other.hwlog"
    path.write_bytes(content)
    with pytest.raises(LogFormatError, match="is not a log of haptic-wall"):
        read_log(path)


def test_pickled_objects_are_never_loaded(tmp_path: Path) -> None:
    path = write(tmp_path / "a.hwlog", rows(2))
    with path.open("ab") as file:
        np.save(file, np.array([{}], dtype=object))
    assert len(read_log(path)[1]) == 2


def test_a_log_of_a_later_version_is_refused(tmp_path: Path) -> None:
    path = write(tmp_path / "a.hwlog", rows(2))
    content = np.frombuffer(b'{"format": "haptic-wall log", "version": 9}', np.uint8)
    with path.open("wb") as file:
        np.save(file, content)
    with pytest.raises(LogFormatError, match="version 9"):
        read_log(path)


@given(st.data())
def test_another_writer_goes_on_where_one_was_killed(
    tmp_path_factory: pytest.TempPathFactory, data: st.DataObject
) -> None:
    path = write(tmp_path_factory.mktemp("log") / "a.hwlog")
    begun = path.stat().st_size
    write(path, rows(3), rows(4, 3))
    path.write_bytes(path.read_bytes()[: data.draw(st.integers(begun, path.stat().st_size))])
    with LogWriter.resume(path, ROW) as log:
        there = 0 if log.found is None else int(log.found["seq"][-1]) + 1
        assert there in (0, 3, 7)
        log.append(rows(9 - there, there))
    np.testing.assert_array_equal(read_log(path)[1], rows(9))


def test_a_log_cut_off_before_its_first_row_or_of_other_rows_is_not_gone_on_with(
    tmp_path: Path,
) -> None:
    path = write(tmp_path / "a.hwlog", rows(3))
    with pytest.raises(LogFormatError, match="other columns"):
        LogWriter.resume(path, np.dtype([("seq", "<i8")]))
    assert len(read_log(path)[1]) == 3, "and it is left as it was"
    path.write_bytes(path.read_bytes()[:100])
    with pytest.raises(LogFormatError, match="metadata"):
        LogWriter.resume(path, ROW)


def test_a_log_takes_its_place_with_its_first_rows(tmp_path: Path) -> None:
    path = write(tmp_path / "a.hwlog", rows(9))
    before = path.read_bytes()
    with LogWriter(path, METADATA, ROW, Beside(path, LOG)):
        assert path.read_bytes() == before
    assert [file.name for file in tmp_path.iterdir()] == ["a.hwlog"]
    with LogWriter(path, METADATA, ROW, Beside(path, LOG)) as log:
        log.append(rows(0))
        assert path.read_bytes() == before
        log.append(rows(3))
        np.testing.assert_array_equal(read_log(path)[1], rows(3))
        log.append(rows(2, 3))
    np.testing.assert_array_equal(read_log(path)[1], rows(5))


def test_rows_that_could_not_take_their_place_are_written_when_they_can(tmp_path: Path) -> None:
    path = tmp_path / "a.hwlog"
    path.write_text("mine")
    with LogWriter(path, METADATA, ROW, Beside(path, LOG)) as log:
        for _ in range(2):
            with pytest.raises(FileExistsError, match="not a log of haptic-wall"):
                log.append(rows(3))
        assert path.read_text() == "mine"
        path.unlink()
        log.append(rows(3))
    np.testing.assert_array_equal(read_log(path)[1], rows(3))
