"""What helps where the kernel refuses the real-time scheduler."""

from __future__ import annotations

import resource
from pathlib import Path

import pytest

from haptic_wall.controller.runtime import realtime

RIGHTS, NO_RIGHTS = "CapEff:\t000001ffffffffff", "CapEff:\t0000000000000000"


@pytest.mark.parametrize(
    ("files", "said"),
    [
        ({"proc/sys/kernel/sched_rt_runtime_us": "0"}, "sudo sysctl"),
        ({"proc/self/status": RIGHTS}, "root group"),
        ({"proc/self/status": NO_RIGHTS}, "prlimit --rtprio"),
        ({}, "prlimit --rtprio"),
    ],
)
def test_the_remedy_is_for_the_cause(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, files: dict[str, str], said: str
) -> None:
    for name, text in files.items():
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_text(text + "\n")
    monkeypatch.setattr(resource, "getrlimit", lambda _which: (0, 0))
    found = realtime.scheduler_remedy(80, tmp_path)
    assert said in found
    assert ("setup-testbed" in found) == (said == "prlimit --rtprio"), "rights do not help there"
