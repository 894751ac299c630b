"""Every command that the pages name is run, or where that takes hardware, refused for its lack.

Runs go by the simulated clock, for a moment: what is held here is that the command exists and takes
what is shown. Nothing is asserted about time.
"""

import os
import re
import sqlite3
from collections.abc import Iterable, Iterator, Sequence
from concurrent.futures import Executor
from contextlib import closing, nullcontext
from importlib.util import find_spec
from pathlib import Path
from typing import NoReturn

import pytest

from haptic_wall.controller.experiments import cluster
from haptic_wall.controller.experiments.maps import maps
from haptic_wall.controller.experiments.testbed import ExperimentInterruptedError, Testbed
from haptic_wall.controller.live.run_socket import AliveRun, socket_of
from haptic_wall.controller.settings.changes import changed, difference
from haptic_wall.controller.settings.load import load_config
from tests.cases import whole_only
from tests.docs.pages import ROOT, commands, text_of
from tests.support.program import call, python, started
from tests.typed import not_none

pytestmark = pytest.mark.usefixtures("undrawn")

RUNS = [(page, words) for page, words in commands() if words[0] in ("haptic-wall", "scripts/run")]
OTHERS = [(page, words) for page, words in commands() if (page, words) not in RUNS]
BUSES = [words for _, words in RUNS if words[1:2] == ("emulate",)]

NOTHING = {"rows": [], "notes": [], "seconds": 0.0}
"""A section of a benchmark that has measured nothing"""


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder with what the pages' commands find: the presets' files, a testbed's, a log."""
    monkeypatch.chdir(tmp_path)
    # What is measured has tests of its own, and takes minutes.
    monkeypatch.setattr("haptic_wall.controller.bench.report.measured_section", lambda _: NOTHING)
    # What is drawn has tests of its own, and takes most of a second each time.
    monkeypatch.setattr(
        "haptic_wall.controller.report.run.plot_run", lambda _s, _m, path, *_: path.touch()
    )
    (tmp_path / "config").symlink_to(ROOT / "config")
    (tmp_path / "docs").mkdir()
    (tmp_path / "docs" / "examples").symlink_to(ROOT / "docs" / "examples")
    (tmp_path / "my-testbed.yaml").write_text((ROOT / "config" / "xm430-w350.yaml").read_text())
    (tmp_path / "leader.yaml").write_text((ROOT / "config" / "xl330-m288.yaml").read_text())
    return tmp_path


MEASURING = ("delay", "identify", "map", "sweep")


@pytest.fixture
def cut_short(monkeypatch: pytest.MonkeyPatch, thorough: bool) -> None:
    """What takes seconds is stopped as soon as it begins; all of it has tests of its own."""
    if thorough:
        return

    def interrupted(*_: object, **__: object) -> NoReturn:
        raise ExperimentInterruptedError("interrupted")

    monkeypatch.setattr(Testbed, "play", interrupted)
    monkeypatch.setattr(
        "haptic_wall.controller.experiments.recorded.estimate.identify_record", Nobody().submit
    )
    # Its own module comes last: one that imported it meanwhile would keep what takes its place.
    for module in ("commission.steps", "sweep.sweep"):
        monkeypatch.setattr(
            f"haptic_wall.controller.experiments.{module}.sweep", lambda *_, **__: False
        )
    monkeypatch.setattr("haptic_wall.controller.experiments.zwidth._POINTS", 4)
    monkeypatch.setattr(maps, "processes", lambda _count: nullcontext(Nobody()))
    monkeypatch.setattr(cluster, "cluster", lambda _address: nullcontext(Nobody()))
    monkeypatch.setattr(
        "haptic_wall.controller.report.boundary.plot_boundary",
        lambda _question, _found, path: path.touch(),
    )
    monkeypatch.setattr("haptic_wall.controller.cli.paper._NAMES", ["fig8"])


class Nobody(Executor):
    """Is interrupted before it takes a task."""

    def submit(self, *_: object, **__: object) -> NoReturn:
        raise KeyboardInterrupt


def shown(found: tuple[str, tuple[str, ...]]) -> str:
    page, words = found
    return f"{page}: {' '.join(words)}"


def value_of(words: Sequence[str], option: str) -> str | None:
    return words[words.index(option) + 1] if option in words else None


def run_quickly(
    words: list[str], folder: Path, capsys: pytest.CaptureFixture[str]
) -> tuple[int, int]:
    """A ``run`` in the way that fits its servo; its exit status, and the one wanted."""
    if "--hold" in words:  # the device is another machine's
        at = words.index("--hold")
        words = words[:at] + words[at + 2 :]
    config = words[0] if words and not words[0].startswith("-") else "simulated"
    sets = [words[i + 1] for i, word in enumerate(words) if word == "--set"]
    wrong = call("config", config, *(f"--set={s}" for s in sets))
    capsys.readouterr()
    if wrong:
        return call(*words), 2
    extra = ["--duration=0.1"]
    if load_config(config, sets).config.servo.kind == "hardware":
        # Another port than the one named: where the tests run, a servo may be at that one.
        nowhere = folder / "ttyUSB0"
        status = call("run", *words, *extra, "--set", f"servo.port={nowhere}")
        assert f"Port {nowhere} does not exist" in capsys.readouterr().err
        return status, 4
    # A record is kept by an emulator in its own process only; what is watched runs in real time.
    if "--witness" in words:
        at = words.index("--witness")
        words = words[:at] + words[at + 2 :]
    words = [word for word in words if word not in ("--live", "--live-control")]
    tripping = "safety.max_speed=0.5" in sets
    extra = [] if tripping else extra
    return call("run", *words, *extra, "--set", "loop.clock=simulated"), 3 if tripping else 0


def look(words: list[str], folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """A ``scan`` or ``doctor``, at a port where nothing is unless it brings its own bus."""
    nowhere = folder / "ttyUSB0"
    if words[0] == "scan":
        assert call(*words, "--port", str(nowhere)) == 4
    elif load_config(words[1]).config.servo.kind == "emulated":
        assert call(*words, "--set", "realtime.profile=off") in (0, 1)  # it also judges time
    else:
        assert call(*words, "--set", f"servo.port={nowhere}") == 4
    assert "Traceback" not in capsys.readouterr().err


@pytest.fixture
def running_wall(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A run that is asked for changes: it takes what its configuration takes."""
    run = AliveRun(socket_of(folder / "runs" / "run.hwlog"), os.getpid())
    config = load_config("simulated").config

    def ask(_run: AliveRun, sets: Sequence[str], wait_s: float, _tell: object) -> dict[str, object]:
        assert wait_s > 0.0
        values = dict(difference(config, changed(config, sets)))
        commanded = {"stiffness": 4.0, "damping": 0.02}
        guard = {"commanded": commanded, "reasons": []}
        return {"applied": True, "changed": values, "waited_s": 0.1, "guard": guard}

    monkeypatch.setattr("haptic_wall.controller.live.run_socket.alive", lambda: [run])
    monkeypatch.setattr("haptic_wall.controller.live.ask.ask", ask)


async def served_nobody(*_: object) -> None:
    """Serves until Ctrl-C, which comes at once."""


SLOW = {"acceptance", "boundary", "doctor", "run", "zwidth"}
"""Commands that take half a second, of which --whole runs all that the pages show"""


def each_first(
    commands_shown: Iterable[tuple[str, tuple[str, ...]]],
) -> Iterator[object]:
    """All commands; of those that are slow, the first with these options is not left to --whole."""
    met: set[tuple[str, ...]] = set()
    for page, words in commands_shown:
        name, options = words[1:2], sorted({w.partition("=")[0] for w in words if w[:2] == "--"})
        key = (*name, *(options if name == ("run",) else ()))
        yield whole_only((page, words)) if key in met and {*name} <= SLOW else (page, words)
        met.add(key)


@pytest.mark.usefixtures("cut_short", "running_wall")
@pytest.mark.parametrize("found", [*each_first(f for f in RUNS if f[1] not in BUSES)], ids=shown)
def test_commands_of_the_program(
    found: tuple[str, tuple[str, ...]],
    folder: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
    thorough: bool,
) -> None:
    _, (first, *words) = found
    if first == "scripts/run":
        words = ["run", *words]
    if words[:1] == ["run"]:
        status, wanted = run_quickly(words[1:], folder, capsys)
        assert status == wanted
        return
    if words[0] in ("scan", "doctor"):
        look(words, folder, capsys)
        return
    if words[0] in ("acceptance", "commission"):
        words = [*words, "--help"]  # what it does has tests of its own, and takes a minute
    if words[0] == "init":
        (folder / words[1]).unlink(missing_ok=True)
    if words[0] == "live":  # it serves until Ctrl-C
        monkeypatch.setattr("haptic_wall.controller.live.server.LiveServer.run", served_nobody)
    if words[0] == "demo":  # so does this one; what it serves has tests of its own
        monkeypatch.setattr("haptic_wall.controller.cli.demo._show", lambda *_: None)
    if words[0] in ("log", "live"):
        seconds = float(value_of(words, "--from") or -0.9) + 1.0
        quick = [f"--duration={seconds}", "--set=loop.clock=simulated", "--set=loop.rate_hz=250"]
        assert call("run", "--log", words[1], *quick) == 0
    assert call(*words) == (0 if thorough or words[0] not in MEASURING else 130)
    if (csv := value_of(words, "--csv")) is not None:
        assert (folder / csv).read_text().startswith("time_s,position_rad,torque_nm,")


@pytest.mark.usefixtures("folder")
@pytest.mark.parametrize("found", OTHERS, ids=shown)
def test_other_commands(found: tuple[str, tuple[str, ...]]) -> None:
    _, words = found
    match words:
        case (".", activate):
            assert activate == ".venv/bin/activate"
        case ("sqlite3", log, query):
            quick = ["--duration=0.1", "--set=loop.clock=simulated", "--no-plot"]
            assert call("run", "--log", log, *quick) == 0
            with closing(sqlite3.connect(log)) as db:
                assert len(db.execute(query).fetchall()) == 10
        case ("dask", command, *_):
            assert find_spec(f"distributed.cli.dask_{command}") is not None
        case (name, *_) if name.startswith("scripts/"):
            assert os.access(ROOT / name, os.X_OK)
        case _:
            pytest.fail(
                f"nobody checks {words[0]}: say here how to, or take it out of the sh block"
            )


@pytest.mark.realtime
def test_the_vendors_client(tmp_path: Path) -> None:
    """The example with dynamixel-sdk speaks to the bus that the same page starts."""
    page = "docs/how-to/emulated-bus.md"
    words = next(words for found, words in RUNS if words in BUSES and found == page)
    (example,) = re.findall(r"^```python\n(.*?)^```", text_of(page), re.S | re.M)
    link, record = not_none(value_of(words, "--link")), value_of(words, "--record")
    assert link in example
    here = {link: str(tmp_path / "bus"), record: str(tmp_path / "truth.csv")}
    with started(*(here.get(word, word) for word in words[1:])) as emulator:
        path = not_none(emulator.stdout).readline()
        assert path.startswith("/dev/pts/"), not_none(emulator.stderr).read()
        done = python("-c", example.replace(link, here[link]))
        assert done.returncode == 0, done.stderr
        emulator.terminate()
        assert emulator.wait(10) == 0
    heard = (tmp_path / "truth.csv").read_text()
    assert ",rx,1,1," in heard  # the ping has arrived
