"""Writes and finds the blocks of a log: ``.npy`` arrays whose header also holds checksums.

The header of a ``.npy`` array is a Python literal, in which every reader takes the text after a
``#`` for a comment. The comment holds the checksums of the header and of the data. A reader that
uses them distinguishes intact blocks from damaged ones; ``numpy.load`` reads the same bytes.
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
"""The header's length is padded to a multiple of this [bytes], as the format requires."""
_HEADER = re.compile(
    rb"(?P<head>\{'descr': (?P<descr>.+), 'fortran_order': False,"
    rb" 'shape': \((?P<count>\d{1,18}),\), \})"
    rb"(?P<sums>  # crc32 (?P<own>[0-9a-f]{8}) (?P<data>[0-9a-f]{8}))? *\n"
)
_BEGIN = re.compile(re.escape(MAGIC) + rb"[\s\S]{2}\{'descr': ")
"""The beginning of a block. The magic bytes alone would give millions of false candidates."""
_BEGIN_BYTES = len(MAGIC) + 12
_PIECE = 1 << 20
"""Largest step of the search for the next block [bytes]"""
_FIRST_PIECE = 1 << 12
"""First step of the search [bytes]: the next block may be near"""
MOST_BYTES = 1 << 24
"""Largest data of a block; a recorder that catches up writes at most 11 MB."""
_MOST_HEADER = 1 << 12
"""Largest header of a block [bytes]"""


@dataclass(frozen=True, slots=True)
class Block:
    """An intact block: its array, and the offset where the next block begins."""

    array: NDArray[Any]
    end: int
    summed: bool
    """The block carries checksums, and they are correct"""


def encoded(array: NDArray[Any]) -> tuple[bytes, memoryview]:
    """Encode a one-dimensional little-endian array as a block; return its header and its data.

    The data are the array's own memory: it must not change until both are written.
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
    """Return the block at ``start``; None unless it is whole and its checksums are correct.

    Blocks of earlier versions have no checksums; they are accepted.

    Args:
        file: Open for reading; the call moves its position.
        start: Offset of the block [bytes].
        end: Size of the file [bytes].
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


@functools.lru_cache(maxsize=8)  # all blocks of a log have the same type
def _dtype(descr: bytes) -> np.dtype[Any] | None:
    """Return the type that a header names; None: no type, or one that holds Python objects."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # a damaged header as Python source may cause warnings
            dtype = npy.descr_to_dtype(ast.literal_eval(descr.decode("ascii")))
    except (ValueError, TypeError, SyntaxError, LookupError, ArithmeticError, MemoryError):
        return None
    except (AttributeError, RuntimeError):  # RuntimeError: brackets nested too deeply
        return None
    return None if dtype.hasobject or dtype.itemsize == 0 else dtype


def last_block(file: BinaryIO, start: int, end: int, checked: bool) -> Block | None:
    """Return the last intact block of rows, searched from the end without reading the whole file.

    Args:
        file: Open for reading; its position is moved.
        start: Offset of the first block [bytes].
        end: Size of the file [bytes].
        checked: A block without checksums counts as damaged.
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
    """Return the next offset [bytes] at which a block may begin; ``end`` if there is none.

    Holes in the file are skipped without reading.
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
    """Return the offset of the next written bytes from ``start`` on [bytes]."""
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
