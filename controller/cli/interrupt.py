"""What a Ctrl-C does where nothing has to be put in order: the process ends, without a word.

That is nearly everywhere. Raised as KeyboardInterrupt in whatever is just being done, it would be
swallowed now and then: libraries that are being loaded turn it into other errors, or print it and
go on. Who has something to put in order hears it by ``controller.signals``, for that while.
"""

from __future__ import annotations

import os
import signal
from types import FrameType

INTERRUPTED = 130
"""Exit status"""


def leave_at_once() -> None:
    """From now on a Ctrl-C ends the process; not where it is ignored, or was handled before.

    One that the launcher has held back does so now.
    """
    if signal.getsignal(signal.SIGINT) is signal.default_int_handler:
        signal.signal(signal.SIGINT, _leave)
    signal.pthread_sigmask(signal.SIG_UNBLOCK, {signal.SIGINT})


def _leave(_signal: int, _frame: FrameType | None) -> None:
    os._exit(INTERRUPTED)
