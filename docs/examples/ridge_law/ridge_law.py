"""A ridge that the shaft must be pushed over."""

import math


class Ridge:
    def __init__(self, height: float = 0.1, width: float = 0.2) -> None:
        self.low, self.high = -width, width  # from wall.position [rad]
        self._height, self._width = height, width  # [N·m], [rad]

    def torque(self, position: float) -> float:  # [N·m]
        return self._height * math.sin(math.pi * position / self._width)
