"""The loop's process says what went wrong in one sentence, whatever it was."""

import json
import os

from haptic_wall.controller.runtime.telemetry import Telemetry
from haptic_wall.controller.settings.load import load_config
from tests.support.program import python

BROKEN = """
from haptic_wall.controller.processes import loop_process

def run_session(*_, **__):
    raise ZeroDivisionError("boom")

loop_process.run_session = run_session
loop_process.main()
"""


def test_an_error_nobody_foresaw_is_told_once_and_named_a_defect() -> None:
    telemetry = Telemetry.create()
    orders = {
        "config": load_config("simulated", []).config.model_dump_json(),
        "telemetry": telemetry.descriptor,
        "port": None,
        "hand": None,
        "key": None,
        "parent": os.getpid(),
        "core": min(os.sched_getaffinity(0)),
        "duration_s": 1.0,
        "program": [],
        "elastic": False,
    }
    fds = [telemetry.descriptor]
    done = python("-c", BROKEN, input=json.dumps(orders) + "\n", pass_fds=fds, timeout=60)
    assert done.stderr == ""
    (line,) = done.stdout.splitlines()
    told = json.loads(line)
    assert told["event"] == "refused"
    assert "ZeroDivisionError: boom" in told["problem"]["what"]
    assert "in run_session, <string> line 5" in told["problem"]["what"]
    assert "defect" in told["problem"]["advice"]
