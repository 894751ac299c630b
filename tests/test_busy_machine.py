"""A run with its own bus on a machine that somebody else keeps busy, without real-time rights."""

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from tests.support.program import PROGRAM

RUNS = 20
WITHOUT_RIGHTS = ["prlimit", "--rtprio=0", "--memlock=65536", "setpriv"]
WITHOUT_RIGHTS += ["--bounding-set=-all", "--inh-caps=-all"]


@pytest.mark.thorough
@pytest.mark.realtime
def test_beside_a_burner_nearly_every_run_ends_as_planned_and_others_name_the_stall(
    tmp_path: Path,
) -> None:
    """Four minutes; the run's core is the burner's."""
    if os.geteuid() == 0 and not shutil.which("setpriv"):
        pytest.skip("setpriv is not installed")
    rights = WITHOUT_RIGHTS if os.geteuid() == 0 else []
    core = max(os.sched_getaffinity(0))
    burn = f"import os; os.sched_setaffinity(0, [{core}])\nwhile True: pass"
    run = ["run", "emulated-xm430", "--duration", "5", "--no-plot", "--json"]
    planned = 0
    burner = subprocess.Popen([sys.executable, "-c", burn])
    try:
        for number in range(RUNS):
            said = subprocess.run(
                [*rights, *PROGRAM, *run, "--log", str(tmp_path / f"{number}.hwlog")],
                capture_output=True,
                text=True,
                check=False,
            )
            if said.returncode == 0:
                planned += json.loads(said.stdout)["stop_reason"] == "duration"
            else:
                assert "this computer stalled" in said.stdout + said.stderr
    finally:
        burner.kill()
        burner.wait()
    assert planned >= 18
