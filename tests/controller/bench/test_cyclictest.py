"""What ``cyclictest`` prints, and how it is asked."""

import stat
from pathlib import Path

import pytest

from haptic_wall.controller.bench import cyclictest
from haptic_wall.controller.errors import PlatformError

PRINTED = """\
# /dev/cpu_dma_latency set to 0us
# Histogram
000000 000000
000001 000002
000002 000003
000003 000001
# Total: 000000006
# Min Latencies: 00001
# Avg Latencies: 00002
# Max Latencies: 00987
# Histogram Overflows: 00002
# Histogram Overflow at cycle number:
# Thread 0: 00163 00170
"""


def test_every_wake_up_that_the_histogram_counts_is_found() -> None:
    # Those beyond its range are known to be at least at its end.
    assert cyclictest.parsed(PRINTED).tolist() == [1, 1, 2, 2, 2, 3, 4, 4]


@pytest.mark.parametrize(
    "text",
    [
        "",
        "T: 0 ( 1234) P:80 I:1000 C: 1000 Min: 9 Act: 20 Avg: 23 Max: 987",
        PRINTED.replace("000002 000003\n", ""),
        PRINTED.replace("# Histogram Overflows: 00002\n", ""),
        PRINTED.replace(" 000003", " 000003 000004"),  # of two threads
    ],
)
def test_other_output_is_refused(text: str) -> None:
    with pytest.raises(PlatformError, match="install another version"):
        cyclictest.parsed(text)


def test_what_it_says_when_it_is_refused_is_told(tmp_path: Path) -> None:
    program = tmp_path / "cyclictest"
    program.write_text("#!/bin/sh\necho 'WARN: distance' >&2\necho 'No rights!' >&2\nexit 1\n")
    program.chmod(program.stat().st_mode | stat.S_IXUSR)
    with pytest.raises(PlatformError, match=r"ended with 1: No rights!$"):
        cyclictest.lateness_us(str(program), 0, 10)
    with pytest.raises(PlatformError, match="could not be run"):
        cyclictest.lateness_us(str(tmp_path / "none"), 0, 10)
