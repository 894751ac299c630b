"""A Ctrl-C while the program is only being loaded ends it without a word."""

import subprocess
import sys

import pytest

INTERRUPTING = """
import os, signal, sys

class Interrupting:
    def find_spec(self, name, path=None, target=None):
        if name == {module!r}:
            os.kill(os.getpid(), signal.SIGINT)

sys.meta_path.insert(0, Interrupting())
sys.argv = ["haptic-wall", "config", "simulated"]
from controller.cli.entry import main
sys.exit(main())
"""


def interrupted(module):
    program = INTERRUPTING.format(module=module)
    return subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, check=False
    )


@pytest.mark.parametrize("module", ["controller.cli.main", "click", "controller.cli.config"])
def test_a_ctrl_c_while_it_loads_is_quiet(module):
    done = interrupted(module)
    assert (done.returncode, done.stdout, done.stderr) == (130, "", "")


@pytest.mark.parametrize("module", ["pydantic", "yaml"])
def test_a_ctrl_c_while_the_command_loads_what_it_needs_is_quiet(module):
    done = interrupted(module)
    assert (done.returncode, done.stderr.strip()) == (130, "")


def test_nobody_interrupts_and_it_does_its_work():
    done = interrupted("nothing")
    assert done.returncode == 0
    assert "wall.stiffness" in done.stdout


def test_an_ignored_ctrl_c_stays_ignored():
    program = "import signal; signal.signal(signal.SIGINT, signal.SIG_IGN)\n"
    done = subprocess.run(
        [sys.executable, "-c", program + INTERRUPTING.format(module="click")],
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0
    assert "wall.stiffness" in done.stdout


def test_once_it_is_loaded_the_command_is_told():
    """What it has begun it ends by itself: files, torque, its report."""
    program = (
        "import os, signal, sys\n"
        "from controller.cli import interrupt, main\n"
        "interrupt.leave_at_once()\n"
        "import controller.cli.presets as presets, click\n"
        "def busy():\n"
        "    try:\n"
        "        os.kill(os.getpid(), signal.SIGINT)\n"
        "        signal.pause()\n"
        "    finally:\n"
        "        print('cleaned up')\n"
        "presets.command = click.Command('presets', callback=busy)\n"
        "sys.exit(main.main(['presets']))\n"
    )
    done = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, check=False
    )
    assert (done.returncode, done.stdout, done.stderr.strip()) == (130, "cleaned up\n", "")
