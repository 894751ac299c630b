"""Blocks of a log: ``.npy`` arrays whose header also holds checksums, found again after damage.

The header of a ``.npy`` array is a Python literal, and what follows a ``#`` in it is a comment to
every reader: there stand the checksum of the header itself and that of the data. So a reader that
knows of them tells an intact block from a damaged one, and ``numpy.load`` reads the same bytes.
"""

from __future__ import annotations

import ast
import errno
import functools
import os
import re
import warnings
import zlib
from dataclasses import dataclass
from typing import Any, BinaryIO

import numpy as np
from numpy.lib import format as npy
from numpy.typing import NDArray

MAGIC = b"\x93NUMPY\x01\x00"
"""First bytes of every block: those of a ``.npy`` array of format 1.0."""

_ALIGNED = 64
"""Bytes that a header is padded to a multiple of, as the format asks for."""
_HEADER = re.compile(
    rb"(?P<head>\{'descr': (?P<descr>.+), 'fortran_order': False,"
    rb" 'shape': \((?P<count>\d{1,18}),\), \})"
    rb"(?P<sums>  # crc32 (?P<own>[0-9a-f]{8}) (?P<data>[0-9a-f]{8}))? *\n"
)
_BEGIN = re.compile(re.escape(MAGIC) + rb"[\s\S]{2}\{'descr': ")
"""Of a block: without its first words magic bytes alone, millions of them, would be looked into."""
_BEGIN_BYTES = len(MAGIC) + 12
_PIECE = 1 << 20
"""Bytes looked through at a time for the next block, at most"""
_FIRST_PIECE = 1 << 12
"""And at first, since it may be near"""
MOST_BYTES = 1 << 24
"""No block of ours has more data: what a recorder may have to catch up with is 11 MB."""
_MOST_HEADER = 1 << 12
"""Nor a longer header"""


@dataclass(frozen=True, slots=True)
class Block:
    """An intact array, and where the next one begins."""

    array: NDArray[Any]
    end: int
    summed: bool
    """It carries checksums, and they are right"""


def encoded(array: NDArray[Any]) -> tuple[bytes, memoryview]:
    """The block of a one-dimensional array, little-endian: its header, and the array's own bytes.

    The array must stay what it is until they are written.
    """
    data = np.ascontiguousarray(array).view(np.uint8).data
    head = (
        f"{{'descr': {npy.dtype_to_descr(array.dtype)!r}, 'fortran_order': False,"
        f" 'shape': ({array.size},), }}"
    )
    sums = "  # crc32 {:08x} {:08x}"
    length = len(MAGIC) + 2 + len(head) + len(sums.format(0, 0)) + 1
    padding = " " * (-length % _ALIGNED) + "\n"

    def header(own: int, of_data: int) -> bytes:
        text = (head + sums.format(own, of_data) + padding).encode("ascii")
        return MAGIC + len(text).to_bytes(2, "little") + text

    of_data = zlib.crc32(data)
    return header(zlib.crc32(header(0, of_data)), of_data), data


def block_at(file: BinaryIO, start: int, end: int) -> Block | None:
    """The block that begins at ``start``, if a whole one does whose checksums are right.

    Logs of before had none, so that a block may lack them.

    Args:
        file: Open for reading; its position is moved to where it was read to.
        start: Where it should begin [bytes].
        end: Where the file ends [bytes].
    """
    file.seek(start)
    begin = file.read(len(MAGIC) + 2)
    if len(begin) < len(MAGIC) + 2 or not begin.startswith(MAGIC):
        return None
    length = int.from_bytes(begin[-2:], "little")
    header = file.read(length) if length <= _MOST_HEADER else b""
    found = _HEADER.fullmatch(header)
    if found is None:
        return None
    if found["sums"] is not None:
        zeroed = header[: found.start("own")] + b"0" * 8 + header[found.end("own") :]
        if zlib.crc32(begin + zeroed) != int(found["own"], 16):
            return None
    dtype = _dtype(found["descr"])
    if dtype is None:
        return None
    data_start = start + len(begin) + len(header)
    needed = int(found["count"]) * dtype.itemsize
    if needed > min(MOST_BYTES, end - data_start):
        return None
    data = file.read(needed)
    if len(data) < needed or (
        found["sums"] is not None and zlib.crc32(data) != int(found["data"], 16)
    ):
        return None
    return Block(np.frombuffer(data, dtype), data_start + needed, found["sums"] is not None)


@functools.lru_cache(maxsize=8)  # all blocks of a log name the same one
def _dtype(descr: bytes) -> np.dtype[Any] | None:
    """The type that a header names; None: none, or one that holds Python objects."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # of what a damaged header looks like as Python
            dtype = npy.descr_to_dtype(ast.literal_eval(descr.decode("ascii")))
    except (ValueError, TypeError, SyntaxError, LookupError, ArithmeticError, MemoryError):
        return None
    except (AttributeError, RuntimeError):  # RuntimeError: brackets nested too deeply
        return None
    return None if dtype.hasobject or dtype.itemsize == 0 else dtype


def last_block(file: BinaryIO, start: int, end: int, checked: bool) -> Block | None:
    """The last intact block of rows, looked for from the end: a file of days is not read for it.

    Args:
        file: Open for reading; its position is moved.
        start: Where blocks begin [bytes].
        end: Where the file ends [bytes].
        checked: Whether a block without checksums counts as damaged.
    """
    after = end
    while after > start:
        before = max(start, after - _PIECE)
        file.seek(before)
        piece = file.read(min(after + len(MAGIC) - 1, end) - before)
        place = piece.rfind(MAGIC)
        while place >= 0:
            block = block_at(file, before + place, end)
            if (
                block is not None
                and block.array.dtype.names is not None
                and (block.summed or not checked)
            ):
                return block
            place = piece.rfind(MAGIC, 0, place + len(MAGIC) - 1)
        after = before
    return None


def next_begin(file: BinaryIO, start: int, end: int) -> int:
    """Where a block may begin next, from ``start`` on; ``end``, if none does [bytes].

    Where nothing was ever written (a hole in the file) nothing is read.
    """
    overlap = _BEGIN_BYTES - 1
    length = _FIRST_PIECE
    while start < end:
        start = _written_from(file, start, end) if length > _FIRST_PIECE else start
        file.seek(start)
        piece = file.read(min(length, end - start))
        length = min(4 * length, _PIECE)
        found = _BEGIN.search(piece)
        if found is not None:
            return start + found.start()
        if len(piece) <= overlap:
            return end
        start += len(piece) - overlap
    return end


def _written_from(file: BinaryIO, start: int, end: int) -> int:
    """Where the next bytes are that were written, from ``start`` on [bytes]."""
    if not hasattr(os, "SEEK_DATA"):
        return start
    descriptor = file.fileno()
    before = os.lseek(descriptor, 0, os.SEEK_CUR)
    try:
        return min(end, os.lseek(descriptor, start, os.SEEK_DATA))
    except OSError as error:
        return end if error.errno == errno.ENXIO else start
    finally:
        os.lseek(descriptor, before, os.SEEK_SET)  # the buffer counts on it
