"""Some of the files of the study of mutations, from a fixed seed; a defect would be noticed."""

import re
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from haptic_wall.controller.logs.recording import parted, sliced
from scripts.mutation_trial import KINDS, tried
from scripts.studies.mutations import COUNTS, FAULTS, NAMES
from scripts.study import PART
from tests.controller.experiments.commission.test_commission import SIMULATED, call, steps_taken
from tests.docs.pages import ROOT, text_of

pytestmark = pytest.mark.usefixtures("undrawn")

SOME = {"logs": 8, "crafted": 5, "configurations": 5, "csvs": 5}
SEED = 0


def faults(kind: str, folder: Path, count: int, base: Path = Path(), least: int = 0) -> list[str]:
    """The faults of some files, until there are ``least``."""
    found = []
    for number in range(count):
        trial = tried(kind, number, SEED, folder, base, limited=False)
        found += [f"{kind} {number} {trial.how}: {fault}" for fault in trial.faults.items()]
        if least and len(found) >= least:
            break
    return found


@pytest.mark.parametrize("kind", SOME)
def test_no_file_is_read_wrongly_or_ends_in_a_traceback(
    kind: str, tmp_path: Path, thorough: bool, wholly: bool
) -> None:
    many = 40 if thorough else 4 if wholly else 1
    assert faults(kind, tmp_path, many * SOME[kind]) == []


def test_no_folder_of_a_commissioning_is(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, thorough: bool, wholly: bool
) -> None:
    base, folder = tmp_path / "base", tmp_path / "tried"
    folder.mkdir()
    steps_taken(monkeypatch, {"nothing": None})
    assert call("commission", *SIMULATED, "--out", base) == 0
    assert faults("folders", folder, 200 if thorough else 40 if wholly else 10, base) == []


def half_parted(whole: Any, period: float, notes: Any) -> list[Any]:
    """As it is parted, but for the half of each part, which is lost."""
    return [sliced(part, 0, part.times.size // 2) for part in parted(whole, period, notes)]


@pytest.mark.parametrize(
    ("kind", "place", "wrong", "fault"),
    [
        ("logs", "haptic_wall.controller.logs.reader.in_order", iter, "traceback"),
        ("logs", "haptic_wall.controller.logs.blocks.zlib.crc32", lambda *_: 0, "wrong"),
        ("crafted", "haptic_wall.controller.logs.content.fault", lambda _rows: None, "traceback"),
        ("logs", "haptic_wall.controller.logs.replayed.replayed", lambda *_: 1 / 0, "traceback"),
        ("crafted", "haptic_wall.controller.cli.options.printable", "\x07{}".format, "terminal"),
        ("configurations", "haptic_wall.controller.cli.config._value", lambda *_: 7.25, "wrong"),
        ("csvs", "haptic_wall.controller.logs.csv_recording.parted", half_parted, "wrong"),
    ],
)
def test_a_defect_is_noticed(
    kind: str,
    place: str,
    wrong: Callable[..., object],
    fault: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(place, wrong)
    assert f"('{fault}'" in faults(kind, tmp_path, 200, least=1)[0]


def test_the_page_is_of_this_script() -> None:
    text = text_of("docs/evidence/mutations.md")
    (part,) = (found[3] for found in PART.finditer(text) if found[2] == "mutations")
    head, _, *rows = [line for line in part.splitlines() if line.startswith("|")]
    assert len(rows) == len(NAMES)
    assert [name.strip() for name in head.strip("|").split("|")][5:] == [*FAULTS.values()]
    cells = [[cell.strip() for cell in row.strip("|").split("|")] for row in rows]
    assert {row[0]: int(row[1]) for row in cells} == {NAMES[k]: COUNTS[k] for k in KINDS}
    for row in cells:
        assert int(row[1]) == sum(map(int, row[2:5])), "each is read, told or refused"
        assert row[5:] == ["0"] * len(FAULTS), "run scripts/study mutations"
    assert re.search(r"^Seed 1\. The slowest took", part, re.M)


@pytest.mark.whole
def test_files_are_tried_in_processes_of_their_own(tmp_path: Path) -> None:
    page = tmp_path / "page.md"
    page.write_text("<!-- computed: mutations -->\n<!-- end -->\n")
    command = ["mutations", "--kinds", "configurations", "--share", "0.004", "--workers", "1"]
    done = subprocess.run(
        [sys.executable, "-m", "scripts.study", *command, "--out", str(page)],
        capture_output=True, text=True, check=True, cwd=ROOT,
    )  # fmt: skip
    assert "| configurations | 2 |" in done.stdout
    assert "MB beyond the program's own" in page.read_text()
