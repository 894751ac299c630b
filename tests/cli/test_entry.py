"""The command from its first instant: a Ctrl-C is quiet, and its own packages come first."""

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from tests.cases import whole_only

INTERRUPTING = """
import os, signal, sys

class Interrupting:
    def find_spec(self, name, path=None, target=None):
        if name == {module!r}:
            os.kill(os.getpid(), signal.SIGINT)

sys.meta_path.insert(0, Interrupting())
sys.argv = ["haptic-wall", "config", "simulated"]
from haptic_wall.controller.cli.entry import main
sys.exit(main())
"""


def interrupted(module: str) -> subprocess.CompletedProcess[str]:
    program = INTERRUPTING.format(module=module)
    return subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, check=False
    )


@pytest.mark.parametrize(
    ("module", "words"),
    [
        ("haptic_wall.controller.cli.main", ("config", "simulated")),
        ("pydantic", ("config", "simulated")),
        # Raised in them it would be an ImportError now and then, or be forgotten.
        ("haptic_wall.controller.experiments.identify.excitation", ("identify", "simulated")),
        ("haptic_wall.controller.bench.lateness", ("bench",)),
        whole_only("click", ("config", "simulated")),
        whole_only("yaml", ("config", "simulated")),
        whole_only("scipy.optimize", ("identify", "simulated")),
    ],
)
def test_a_ctrl_c_while_it_loads_is_quiet(
    module: str, words: tuple[str, ...], tmp_path: Path
) -> None:
    given = ", ".join(f'"{word}"' for word in words)
    program = INTERRUPTING.replace('"config", "simulated"', given).format(module=module)
    done = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, check=False, cwd=tmp_path
    )
    assert (done.returncode, done.stdout) == (130, "")
    assert words == ("bench",) or done.stderr.strip() == ""


@pytest.mark.parametrize(
    ("module", "number"),
    [
        ("haptic_wall.controller.cli.main", "SIGINT"),
        ("yaml", "SIGTERM"),
        whole_only("haptic_wall.controller.cli.main", "SIGTERM"),
        whole_only("yaml", "SIGINT"),
    ],
)
def test_with_json_a_signal_is_one_object(module: str, number: str) -> None:
    program = INTERRUPTING.replace('"simulated"', '"simulated", "--json"').format(module=module)
    program = program.replace("SIGINT", number)
    done = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, check=False
    )
    assert (done.returncode, done.stderr) == (130, "")
    assert json.loads(done.stdout) == {
        "error": "interrupted",
        "field": None,
        "advice": None,
        "exit_status": 130,
    }


def test_after_its_answer_a_ctrl_c_says_nothing_more() -> None:
    program = (
        "import os, signal, sys\n"
        "from haptic_wall.controller.cli import interrupt, options\n"
        "sys.argv = ['haptic-wall', 'presets', '--json']\n"
        "interrupt.leave_at_once()\n"
        "from haptic_wall.controller.cli.main import main\n"
        "print_ = options.click.echo\n"
        "def echo(*a, **k):\n"
        "    print_(*a, **k)\n"
        "    os.kill(os.getpid(), signal.SIGINT)\n"
        "options.click.echo = echo\n"
        "main()\n"
    )
    done = subprocess.run(
        [sys.executable, "-uc", program], capture_output=True, text=True, check=False
    )
    assert done.returncode == 130
    assert "presets" in json.loads(done.stdout)


def test_an_ignored_ctrl_c_stays_ignored() -> None:
    program = "import signal; signal.signal(signal.SIGINT, signal.SIG_IGN)\n"
    done = subprocess.run(
        [sys.executable, "-c", program + INTERRUPTING.format(module="click")],
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0
    assert "wall.stiffness" in done.stdout


def test_what_is_begun_is_put_in_order(tmp_path: Path) -> None:
    program = (
        "import os, pathlib, signal\n"
        "from haptic_wall.controller.cli import interrupt\n"
        "from haptic_wall.controller.system.whole_file import whole\n"
        "interrupt.leave_at_once()\n"
        "try:\n"
        "    with whole(pathlib.Path('half')) as part:\n"
        "        part.write_text('half')\n"
        "        os.kill(os.getpid(), signal.SIGINT)\n"
        "finally:\n"
        "    print(os.listdir())\n"
        "    os.kill(os.getpid(), signal.SIGINT)\n"
    )
    done = subprocess.run(
        [sys.executable, "-uc", program], capture_output=True, text=True, check=False, cwd=tmp_path
    )
    assert (done.returncode, done.stdout, done.stderr) == (130, "[]\n", "")


def test_a_ctrl_c_at_pythons_own_end_is_left_to_the_system() -> None:
    """Python calls no handler safely there: it aborted."""
    program = (
        "import atexit, os, signal, sys\n"
        "atexit.register(lambda: os.kill(os.getpid(), signal.SIGINT))\n"
        "sys.argv = ['haptic-wall', 'presets']\n"
        "from haptic_wall.controller.cli.entry import main\n"
        "sys.exit(main())\n"
    )
    done = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, check=False
    )
    assert (done.returncode, done.stderr) == (-signal.SIGINT, "")
    assert "simulated" in done.stdout


def test_after_a_keyboard_interrupt_python_does_not_take_its_libraries_apart(
    tmp_path: Path,
) -> None:
    """matplotlib's fonts, which it had come through, aborted there once in a hundred."""
    program = (
        "import atexit, os, signal, sys\n"
        "class Torn:\n"
        "    def __del__(self, abort=os.abort):\n"
        "        abort()\n"
        "torn = Torn()\n"
        "atexit.register(lambda: print('in order'))\n"
        "import haptic_wall.controller.report.boundary\n"
        "def plot(question, found, path):\n"
        "    path.write_text('half')\n"
        "    os.kill(os.getpid(), signal.SIGINT)\n"
        "haptic_wall.controller.report.boundary.plot_boundary = plot\n"
        "sys.argv = 'haptic-wall boundary --servo=MX-64 --rate=1000 --delay=0.002 --plot=b.png"
        " --virtual-damping=0.1'.split()\n"
        "from haptic_wall.controller.cli.entry import main\n"
        "sys.exit(main())\n"
    )
    done = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, check=False, cwd=tmp_path
    )
    assert (done.returncode, done.stdout, done.stderr.strip()) == (130, "in order\n", "")
    assert list(tmp_path.iterdir()) == []


# The launcher, as it is installed

COMMAND = Path(sys.executable).with_name("haptic-wall")
FOLDER = Path(__file__).parents[2] / "controller" / "cli"


def launched(tmp_path: Path, python: str) -> Path:
    """A launcher beside this in place of Python."""
    launcher = tmp_path / "haptic-wall"
    launcher.write_text((FOLDER / "haptic-wall").read_text())
    launcher.chmod(0o755)
    (tmp_path / "stub").write_text(python)
    interpreter = f"exec '{sys.executable}'" if python.startswith("import") else "exec sh"
    (tmp_path / "python3").write_text(f"#!/bin/sh\n{interpreter} '{tmp_path / 'stub'}' \"$@\"\n")
    (tmp_path / "python3").chmod(0o755)
    return launcher


def test_python_starts_with_ctrl_c_held_back(tmp_path: Path) -> None:
    python = """import os, signal, sys
os.kill(os.getpid(), signal.SIGINT)
print("started", *sys.argv[2:], flush=True)
signal.pthread_sigmask(signal.SIG_UNBLOCK, [signal.SIGINT])
"""
    words: list[str | Path] = [launched(tmp_path, python), "run", "a b"]
    done = subprocess.run(words, capture_output=True, text=True, check=False)
    assert done.stdout == "started run a b\n"
    assert "KeyboardInterrupt" in done.stderr  # it was not forgotten


def test_where_env_holds_nothing_back_it_starts_all_the_same(tmp_path: Path) -> None:
    launcher = launched(tmp_path, 'echo "$@"\n')
    (tmp_path / "env").write_text('#!/bin/sh\ncase $1 in -*) exit 125;; esac\nexec "$@"\n')
    (tmp_path / "env").chmod(0o755)
    path = f"{tmp_path}:{os.environ['PATH']}"
    done = subprocess.run(
        [launcher, "x"], capture_output=True, text=True, check=False, env={"PATH": path}
    )
    assert done.stdout == f"{launcher} x\n"


def test_a_ctrl_c_at_any_time_of_its_start_is_quiet() -> None:
    for pause_s in (0.002, 0.006, 0.012, 0.018, 0.025, 0.035):
        started = subprocess.Popen(
            [COMMAND, "run"], stdout=subprocess.PIPE, stderr=subprocess.PIPE, start_new_session=True
        )
        time.sleep(pause_s)
        os.killpg(started.pid, signal.SIGINT)
        out, told = started.communicate()
        assert started.returncode in (130, -signal.SIGINT)
        assert (out, told) == (b"", b"")


def called(folder: Path, *words: str) -> subprocess.CompletedProcess[str]:
    """The command, called in a folder that PYTHONPATH names too."""
    return subprocess.run(
        [COMMAND, *words],
        capture_output=True,
        text=True,
        check=False,
        cwd=folder,
        env=os.environ | {"PYTHONPATH": str(folder)},
    )


@pytest.mark.whole
def test_packages_of_the_same_name_on_the_path_are_not_taken_for_ours(
    tmp_path: Path, wholly: bool
) -> None:
    """Neither by the command nor by its children: loop, recorder, workers."""
    for package in ("controller", "hw"):
        (tmp_path / package).mkdir()
        (tmp_path / package / "__init__.py").write_text("raise SystemExit('not this one')\n")
    done = called(tmp_path, "run", "simulated", "--duration=0.1", "--no-plot", "--json")
    assert done.returncode == 0, done.stderr
    assert json.loads(done.stdout)["log"] is not None
    if not wholly:
        return
    computed = ["--virtual-damping=0", "--delay-steps=0,1", "--kick=0.03", "--workers=2"]
    done = called(tmp_path, "map", "paper-table2", *computed, "--out=out", "--json")
    assert done.returncode == 0, done.stderr
    assert len(json.loads(done.stdout)["points"]) == 2
