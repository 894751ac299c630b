"""A damaged configuration or CSV is read, or refused in one sentence."""

from pathlib import Path
from random import Random

import pytest

from tests.support.told_logs import called

CSV = "time_s,position_rad,torque_nm\n" + "".join(
    f"{n / 1000:.3f},{0.01 * (n % 40 - 20):.4f},{-0.08 * (n % 40 - 20):.3f}\n" for n in range(400)
)
YAML = """\
wall: {stiffness: 8, damping: 0.02, law: sum, parts: [{law: detents, count: 24}, {law: spring}]}
servo: {inertia: 0.002, counts_per_rev: 4096}
model: {inertia: {value: 0.002, low: 0.001, high: 0.003}}
"""
PIECES = (
    *(b"", b"\0", b"\xff\xfe", b"\r", b"\n\n", b",", b'"', b"'", b"{", b"[", b"]]", b":", b"*a"),
    *(b"&a ", b"!!python/object:os.system ", b"nan", b"-inf", b"1e999", b"9" * 400, b"\x1b[2J"),
    *("\u202e".encode(), b"x" * 5000, b"- " * 50),
)


def damaged(random: Random, content: bytes) -> bytes:
    """Cut, repeat, replace, or mix a few stretches."""
    for _ in range(random.choice((1, 1, 2, 5))):
        at, end = sorted(random.randrange(len(content) + 1) for _ in range(2))
        end = min(end, at + random.choice((1, 20, 2000)))
        piece = content[at:end]
        new = random.choice((b"", 2 * piece, random.choice(PIECES), random.randbytes(len(piece))))
        content = content[:at] + new + content[end:]
    return content[: random.randrange(len(content) + 1)] if random.random() < 0.2 else content


@pytest.mark.parametrize("kind", ["a.csv", "a.yaml"])
def test_a_damaged_file_is_read_or_refused_in_one_sentence(
    kind: str, tmp_path: Path, thorough: bool, wholly: bool
) -> None:
    path = tmp_path / kind
    whole = {"a.csv": CSV.encode(), "a.yaml": YAML.encode()}
    names = {"a.yaml": ["config"], "a.csv": ["detect"]}[kind]
    found = []
    for number in range(3000 if thorough else 300 if wholly else 60):
        path.write_bytes(damaged(Random(f"{kind} {number}"), whole[kind]))
        for name in names:
            answer = called(name, path)
            several = answer.status and kind != "a.yaml" and answer.err.count("\n") != 1
            if answer.fault or several:
                found.append(f"{number} {name}: {answer.fault or answer.err}")
    assert found == []
