"""A ridge whose height goes up and down slowly, like breath."""

import math


class Breathing:
    def __init__(self, height: float = 0.1, width: float = 0.2, period: float = 3.0) -> None:
        self.low, self.high = -width, width  # from wall.position [rad]
        self._height, self._width, self._period = height, width, period  # [N·m], [rad], [s]

    def torque(self, position: float, time: float) -> float:  # [rad], [s] -> [N·m]
        height = self._height * (1.0 + 0.5 * math.sin(math.tau * time / self._period))
        return height * math.sin(math.pi * position / self._width)
