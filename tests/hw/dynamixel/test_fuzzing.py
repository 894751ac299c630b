"""Fuzzes the codec and the emulated bus from a fixed seed.

Without coverage to guide it: conversations with the servos, changed at random.
"""

import random
from collections.abc import Sequence

import pytest

from tests.hw.dynamixel import fuzzing


def changed(seed: bytes, others: Sequence[bytes], source: random.Random) -> bytes:
    """As a fuzzer changes an input: bytes, pieces, and pieces of another."""
    data = bytearray(seed)
    for _ in range(source.randint(1, 6)):
        at, end = sorted(source.randrange(len(data) + 1) for _ in range(2))
        match source.randrange(4):
            case 0:
                data[at:at] = source.randbytes(source.randrange(9))
            case 1:
                del data[at : min(end, at + 8)]
            case 2:
                data[at:at] = source.choice(others)[2:]
            case 3 if at < len(data):
                data[at] = source.randrange(256)
    return bytes(data)


@pytest.mark.parametrize("which", [0, 1], ids=["bus", "parser"])
def test_whatever_comes_nothing_breaks_and_all_is_back_in_step(which: int, thorough: bool) -> None:
    seeds = [seed for seed in fuzzing.seeds() if seed[0] == which]
    source = random.Random(which)
    cases = (20_000 if which else 5_000) if thorough else (2_000 if which else 300)
    for number in range(cases):
        seed = seeds[number % len(seeds)]
        data = bytes((which,)) + changed(seed, seeds, source)[1:]
        try:
            fuzzing.run(data)
        except Exception as error:
            error.add_note(f"fuzzing.run(bytes.fromhex('{data.hex()}'))")
            raise
