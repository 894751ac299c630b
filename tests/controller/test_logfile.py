"""A log keeps what was written, byte for byte, whatever becomes of the disk or the writer."""

import errno
import io
import logging

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from controller.errors import LogFormatError
from controller.logfile import LogWriter, read_log

ROW = np.dtype([("seq", "<i8"), ("position", "<f8")])
METADATA = {"name": "simulated", "config": {"wall": {"stiffness": 8.0}}, "unit": "N·m"}


def rows(count, start=0):
    block = np.zeros(count, ROW)
    block["seq"] = np.arange(start, start + count)
    block["position"] = 0.1 * block["seq"]
    return block


def write(path, *blocks):
    with LogWriter(path, METADATA, ROW) as log:
        for block in blocks:
            log.append(block)
    return path


def test_what_was_written_is_read(tmp_path):
    metadata, read = read_log(write(tmp_path / "a.hwlog", rows(3), rows(0), rows(4, 3)))
    assert {**METADATA, **metadata} == metadata
    np.testing.assert_array_equal(read, rows(7))


def test_the_same_rows_give_the_same_bytes(tmp_path):
    first = write(tmp_path / "a.hwlog", rows(5), rows(6, 5)).read_bytes()
    assert write(tmp_path / "b.hwlog", rows(5), rows(6, 5)).read_bytes() == first


def test_numpy_alone_can_read_it(tmp_path):
    path = write(tmp_path / "a.hwlog", rows(3), rows(2, 3))
    with path.open("rb") as file:
        assert np.load(file).tobytes().startswith(b'{"format": "haptic-wall log"')
        np.testing.assert_array_equal(np.load(file), rows(3))
        np.testing.assert_array_equal(np.load(file), rows(2, 3))


def test_blocks_are_readable_before_the_log_is_closed(tmp_path):
    log = LogWriter(tmp_path / "a.hwlog", METADATA, ROW)
    log.append(rows(3))
    np.testing.assert_array_equal(read_log(tmp_path / "a.hwlog")[1], rows(3))
    log.close()
    log.close()


def test_a_log_without_rows_is_empty(tmp_path):
    metadata, read = read_log(write(tmp_path / "a.hwlog"))
    assert metadata["name"] == "simulated"
    assert read.size == 0


@settings(deadline=None)
@given(st.data())
def test_a_log_cut_off_anywhere_keeps_its_whole_blocks(tmp_path_factory, data):
    path = write(tmp_path_factory.mktemp("log") / "a.hwlog")
    ends = [path.stat().st_size]
    blocks = [rows(3), rows(4, 3), rows(2, 7)]
    for count in (1, 2, 3):
        ends.append(write(path, *blocks[:count]).stat().st_size)
    cut = data.draw(st.integers(ends[0], ends[-1]))
    path.write_bytes(path.read_bytes()[:cut])
    whole = sum(len(block) for block, end in zip(blocks, ends[1:], strict=True) if end <= cut)
    assert len(read_log(path)[1]) == whole


def test_a_cut_off_end_is_warned_about(tmp_path, caplog):
    path = write(tmp_path / "a.hwlog", rows(3), rows(3, 3))
    path.write_bytes(path.read_bytes()[:-1])
    with caplog.at_level(logging.WARNING):
        assert len(read_log(path)[1]) == 3
    assert "not a complete block" in caplog.text
    caplog.clear()
    read_log(write(path, rows(3)))
    assert not caplog.records


class _FullDisk(io.FileIO):
    """A disk that takes ``room`` more bytes, a few at a time."""

    room = 0

    def write(self, data):
        taken = min(len(data), self.room, 100)
        if taken == 0:
            raise OSError(errno.ENOSPC, "No space left on device")
        self.room -= taken
        return super().write(bytes(data[:taken]))


def test_a_full_disk_costs_only_what_did_not_fit(tmp_path):
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


def test_metadata_is_json(tmp_path):
    with pytest.raises(ValueError, match="JSON compliant"):
        LogWriter(tmp_path / "a.hwlog", {"delay": float("nan")}, ROW)


@pytest.mark.parametrize(
    "content",
    [b"", b"time_s,position_rad\n0,0\n", b"\x93NUMPY", b"\x93NUMPY\x01\x00v\x00" + b"x" * 118],
)
def test_another_file_is_not_a_log(tmp_path, content):
    path = tmp_path / "other.hwlog"
    path.write_bytes(content)
    with pytest.raises(LogFormatError, match="is not a log of haptic-wall"):
        read_log(path)


def test_a_plain_array_is_not_a_log(tmp_path):
    path = tmp_path / "other.npy"
    np.save(path, np.arange(5))
    with pytest.raises(LogFormatError, match="is not a log of haptic-wall"):
        read_log(path)


def test_pickled_objects_are_never_loaded(tmp_path):
    path = write(tmp_path / "a.hwlog", rows(2))
    with path.open("ab") as file:
        np.save(file, np.array([{}], dtype=object))
    assert len(read_log(path)[1]) == 2


def test_a_log_of_a_later_version_is_refused(tmp_path):
    path = write(tmp_path / "a.hwlog", rows(2))
    path.write_bytes(path.read_bytes().replace(b'"version": 1', b'"version": 9'))
    with pytest.raises(LogFormatError, match="version 9"):
        read_log(path)


@settings(deadline=None)
@given(st.data())
def test_another_writer_goes_on_where_one_was_killed(tmp_path_factory, data):
    path = write(tmp_path_factory.mktemp("log") / "a.hwlog")
    begun = path.stat().st_size
    write(path, rows(3), rows(4, 3))
    path.write_bytes(path.read_bytes()[: data.draw(st.integers(begun, path.stat().st_size))])
    with LogWriter.resume(path, ROW) as log:
        assert log.rows in (0, 3, 7)
        assert (log.last is None) == (log.rows == 0)
        assert log.last is None or log.last["seq"] == log.rows - 1
        log.append(rows(9 - log.rows, log.rows))
        assert log.rows == 9
    np.testing.assert_array_equal(read_log(path)[1], rows(9))


def test_a_log_cut_off_before_its_first_row_or_of_other_rows_is_not_gone_on_with(tmp_path):
    path = write(tmp_path / "a.hwlog", rows(3))
    with pytest.raises(LogFormatError, match="other rows"):
        LogWriter.resume(path, np.dtype([("seq", "<i8")]))
    assert len(read_log(path)[1]) == 3, "and it is left as it was"
    path.write_bytes(path.read_bytes()[:100])
    with pytest.raises(LogFormatError, match="metadata"):
        LogWriter.resume(path, ROW)
