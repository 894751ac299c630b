"""The plugin as others meet it: pytest in a process and a folder of their own."""

import os
import subprocess
import sys
import textwrap
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
import yaml

from haptic_wall.controller.emulated_bus.bus import PROGRAM
from tests.docs.pages import ROOT
from tests.support.program import python, wait_for
from tests.typed import not_none

pytest_plugins = ["pytester"]
pytestmark = pytest.mark.realtime

EXAMPLES = ROOT / "docs" / "examples"
HEAD = "import pytest\nimport dynamixel_sdk as sdk\n"


def emulators(folder: Path) -> list[int]:
    """Processes that run an emulated bus whose files are in this folder."""
    own = os.fsencode(folder) + b"/dynamixel-bus-"
    found = []
    for entry in Path("/proc").glob("[0-9]*/cmdline"):
        try:
            words = entry.read_bytes().split(b"\0")
        except OSError:
            continue
        if PROGRAM.encode() in words and any(own in word for word in words):
            found.append(int(entry.parent.name))
    return found


@pytest.fixture
def outside(
    pytester: pytest.Pytester, monkeypatch: pytest.MonkeyPatch
) -> Iterator[Callable[..., pytest.RunResult]]:
    """Runs tests in an empty folder; no bus may be left over."""
    monkeypatch.setenv("TMPDIR", str(pytester.path))

    def run(text: str, *arguments: str) -> pytest.RunResult:
        pytester.makepyfile(HEAD + textwrap.dedent(text))
        return pytester.runpytest_subprocess("-W", "error", *arguments, timeout=300)

    yield run
    assert emulators(pytester.path) == []


@pytest.mark.whole
def test_one_that_does_not_start_or_dies_says_why_and_leaves_nothing(
    outside: Callable[..., pytest.RunResult],
) -> None:
    done = outside(
        """
        import os, signal

        @pytest.mark.dynamixel_bus(servos=["XM430-W350:1", "XM430-W999:2"])
        def test_unknown_model(dynamixel_bus): pass

        @pytest.mark.dynamixel_bus(faults=["dorp:p=1"])
        def test_unknown_fault(dynamixel_bus): pass

        @pytest.mark.dynamixel_bus(servo="XM430-W350:1")
        def test_unknown_word(dynamixel_bus): pass

        @pytest.mark.dynamixel_bus(["XM430-W350:1"])
        def test_no_word(dynamixel_bus): pass

        @pytest.mark.dynamixel_bus(servos="XM430-W350:1")
        def test_no_list(dynamixel_bus): pass

        @pytest.mark.dynamixel_bus(servos=["XM430-W350:one"])
        def test_no_id(dynamixel_bus): pass

        def test_dies(dynamixel_bus):
            os.kill(dynamixel_bus._process.pid, signal.SIGKILL)

        def test_dies_meanwhile(dynamixel_bus):
            os.kill(dynamixel_bus._process.pid, signal.SIGKILL)
            dynamixel_bus.rows
        """
    )
    done.assert_outcomes(passed=1, failed=1, errors=8)
    said = done.stdout.str()
    for words in (
        "no model 'XM430-W999' is known",
        "did you mean drop",
        "unexpected keyword argument 'servo'",
        "found ['XM430-W350:1'] without a name",
        "wanted a list: ['XM430-W350:1']",
        "found 'XM430-W350:one', wanted MODEL[:ID[:FIRMWARE]]",
        "died: status -9",
        "The emulated bus has died",
    ):
        assert words in said


def test_it_meets_no_modules_of_the_program_under_test(
    outside: Callable[..., pytest.RunResult],
    pytester: pytest.Pytester,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Their own `controller` and `hw`, in the folder and on the path, stay theirs."""
    for name in ("controller", "hw"):
        pytester.makepyfile(**{name: "OURS = False"})
    monkeypatch.setenv("PYTHONPATH", str(pytester.path))
    done = outside(
        """
        import sys
        import controller, hw

        def test_theirs(dynamixel_bus):
            assert not controller.OURS and not hw.OURS

        def test_loaded(request):
            assert request.config.pluginmanager.hasplugin("haptic_wall")
            loaded = {name for name in sys.modules if name.startswith(("haptic_wall", "numpy"))}
            parts = tuple("haptic_wall.controller." + n for n in ("pytest_plugin", "emulated_bus"))
            assert {name for name in loaded if not name.startswith(parts)} == {
                "haptic_wall", "haptic_wall.controller"
            }
        """,
        "--strict-markers",
    )
    done.assert_outcomes(passed=2)


KILLED = """
import os, signal, sys
from haptic_wall.controller.pytest_plugin import DynamixelBus
with DynamixelBus() as bus:
    print(bus.port, flush=True)
    sys.stdin.read()
"""


def test_tests_that_are_killed_leave_no_bus_and_no_folder(tmp_path: Path) -> None:
    words = [sys.executable, "-c", KILLED]
    folders = {"TMPDIR": str(tmp_path)}
    with subprocess.Popen(
        words, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, env=os.environ | folders
    ) as tests:
        assert not_none(tests.stdout).readline().startswith(str(tmp_path))
        assert emulators(tmp_path)
        tests.kill()
    wait_for(lambda: not [*tmp_path.iterdir(), *emulators(tmp_path)], "the end of bus and folder")


@pytest.mark.whole
def test_the_example_passes_and_its_workflow_runs_it(tmp_path: Path) -> None:
    for name in ("move_servo.py", "test_move_servo.py"):
        (tmp_path / name).write_text((EXAMPLES / name).read_text())
    (job,) = yaml.safe_load((EXAMPLES / "ci.yml").read_text())["jobs"].values()
    assert job["runs-on"].startswith("ubuntu")
    install, test = [step["run"] for step in job["steps"] if "run" in step]
    assert install == "python -m pip install pytest haptic-wall"
    done = python(*test.split()[1:], "-q", "-W", "error", cwd=tmp_path)
    assert done.returncode == 0, done.stdout


@pytest.mark.whole
def test_the_page_s_programs_run(tmp_path: Path) -> None:
    page = (ROOT / "docs" / "how-to" / "testing-your-code.md").read_text()
    blocks = [part.partition("```")[0] for part in page.split("```python\n")[1:]]
    for number, block in enumerate(blocks):
        uses = "\n\ndef test_bus(bus):\n    assert bus.ids == (1,)\n" if "def bus(" in block else ""
        (tmp_path / f"test_page_{number}.py").write_text(block + uses)
    done = python("-m", "pytest", "-q", "-W", "error", cwd=tmp_path)
    assert f"{len(blocks)} passed" in done.stdout, done.stdout
