"""Keeps the wall on while a page answers the server's beats: the dead man on the live page.

Each beat has the time at which it was sent, and the page sends that time back while it is held. So
an answer that was late, wherever it waited, holds for what is left of its time only.
"""

from __future__ import annotations

from typing import Final

from haptic_wall.controller.runtime.telemetry import Word

SILENCE_NS: Final = 150_000_000
"""How long a page holds after the beat that it answered [ns]"""
_MS_NS: Final = 1_000_000


class DeadMan:
    """Writes until when the dead man counts as held; one page holds it at a time.

    Args:
        words: Of the run's shared memory.
    """

    def __init__(self, words: memoryview[int]) -> None:
        self._words = words
        self._holder: object = None

    def beat(self, now_ns: int) -> int:
        """Return the beat of a time on the loop's clock [ns], for the pages that may answer."""
        return now_ns // _MS_NS

    def answer(self, page: object, beat: int, now_ns: int) -> None:
        """Renew the hold by a page's answer; without effect while another page holds it.

        Args:
            page: Whose answer.
            beat: As from ``beat``; one that lies in the future counts as that of now.
            now_ns: The present time on the loop's clock [ns].
        """
        if self._holder not in (None, page) and now_ns <= self._words[Word.HELD_NS]:
            return
        until_ns = min(beat * _MS_NS, now_ns) + SILENCE_NS
        if until_ns > max(now_ns, self._words[Word.HELD_NS]):
            self._holder = page
            self._words[Word.HELD_NS] = until_ns

    def release(self, page: object) -> None:
        """Let go at once, if that page holds it."""
        if page is self._holder:
            self._holder = None
            self._words[Word.HELD_NS] = 0
