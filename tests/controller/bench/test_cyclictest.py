"""What ``cyclictest`` prints, and how it is asked."""

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
