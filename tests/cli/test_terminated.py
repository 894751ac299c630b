"""A command that SIGTERM ends in its middle says so in JSON."""

import json
import subprocess
import sys
from pathlib import Path

import pytest

PROGRAM = """
import os, signal, sys, time
import haptic_wall.controller.{module} as module

def ended(*args, **kwargs):
    os.kill(os.getpid(), signal.{number})
    time.sleep(60)

module.{function} = ended
sys.argv = ["haptic-wall", *{words!r}, "--json"]
from haptic_wall.controller.cli.entry import main
sys.exit(main())
"""
SIMULATED = ("simulated", "--set=loop.clock=simulated")
OUT = "--out=new/out"
MIDDLES: dict[str, tuple[str, str, tuple[str, ...]]] = {
    "boundary": (
        *("cli.boundary", "report"),
        ("boundary", "--servo=MX-64", "--period=0.001", "--delay=0.002", "--virtual-damping=0"),
    ),
    "paper": ("paper.items", "make", ("paper", "all", OUT)),
    "identify": ("experiments.identify.identification", "identify", ("identify", *SIMULATED)),
}


@pytest.mark.whole
@pytest.mark.parametrize("number", ["SIGTERM", "SIGINT"])
@pytest.mark.parametrize("middle", MIDDLES)
def test_it_answers_once(middle: str, number: str, tmp_path: Path) -> None:
    module, function, words = MIDDLES[middle]
    program = PROGRAM.format(module=module, function=function, number=number, words=words)
    done = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, check=False, cwd=tmp_path
    )
    assert done.returncode == 130, done.stderr
    assert json.loads(done.stdout)["error"].startswith("interrupted")
    assert json.loads(done.stdout)["exit_status"] == 130
    assert "Traceback" not in done.stderr
