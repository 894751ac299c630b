"""The command from its first instant: a Ctrl-C ends it in a line; its own packages come first."""

import json
import os
import signal
import subprocess
import time
from pathlib import Path

import pytest

from tests.cases import whole_only
from tests.support.program import LAUNCHER, python

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
def test_a_ctrl_c_while_it_loads_is_told_in_a_line(
    module: str, words: tuple[str, ...], tmp_path: Path
) -> None:
    given = ", ".join(f'"{word}"' for word in words)
    program = INTERRUPTING.replace('"config", "simulated"', given).format(module=module)
    done = python("-c", program, cwd=tmp_path)
    assert (done.returncode, done.stdout) == (130, "")
    assert done.stderr.splitlines()[-1] == "haptic-wall: interrupted"
    assert words == ("bench",) or len(done.stderr.splitlines()) == 1


def test_a_ctrl_c_while_it_loads_gives_a_program_its_object(tmp_path: Path) -> None:
    given = '"boundary", "--json"'
    program = INTERRUPTING.replace('"config", "simulated"', given).format(module="click")
    done = python("-c", program, cwd=tmp_path)
    assert json.loads(done.stdout) == {
        "error": "interrupted",
        "field": None,
        "advice": "",
        "exit_status": 130,
    }


def test_a_ctrl_c_at_any_time_of_its_start_leaves_no_traceback() -> None:
    for pause_s in (0.002, 0.006, 0.012, 0.018, 0.025, 0.035):
        started = subprocess.Popen(
            [LAUNCHER, "run"],
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            start_new_session=True,
        )
        time.sleep(pause_s)
        os.killpg(started.pid, signal.SIGINT)
        out, told = started.communicate()
        assert started.returncode in (130, -signal.SIGINT)
        assert (out, told) in {(b"", b""), (b"", b"haptic-wall: interrupted\n")}
