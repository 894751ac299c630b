"""A pseudo-terminal, as a port with nobody on it."""

from __future__ import annotations

import os
import pty
from collections.abc import Iterator

import pytest


class Terminal:
    """The far side's descriptor, and the path of the side to open."""

    def __init__(self) -> None:
        self.far, self.near = pty.openpty()
        self.path = os.ttyname(self.near)

    def hang_up(self) -> None:
        os.close(self.far)
        self.far = -1

    def close(self) -> None:
        os.close(self.near)
        if self.far >= 0:
            self.hang_up()


@pytest.fixture
def terminal() -> Iterator[Terminal]:
    made = Terminal()
    yield made
    made.close()
