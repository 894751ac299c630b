"""A leader arm with virtual walls as a teleoperator of lerobot.

::

    lerobot-teleoperate --teleop.type=haptic_wall --teleop.arm=leader.yaml \
        --robot.type=so101_follower --robot.port=/dev/ttyACM0

An action is one position per axis of the file, named as the axis: name the axes as the follower
names its joints. The walls run in processes of their own, at the file's rate, whatever this program
does meanwhile. When the run ends by itself, a trip for instance, ``get_action`` raises: an old
position is never returned.
"""

import contextlib
import logging
import math
from dataclasses import dataclass, field

from lerobot.teleoperators.config import TeleoperatorConfig
from lerobot.teleoperators.teleoperator import Teleoperator
from lerobot.utils.errors import DeviceAlreadyConnectedError, DeviceNotConnectedError

import haptic_wall

logger = logging.getLogger(__name__)


@TeleoperatorConfig.register_subclass("haptic_wall")
@dataclass(kw_only=True)
class HapticWallConfig(TeleoperatorConfig):
    """What ``--teleop.NAME`` sets."""

    arm: str
    """Configuration of haptic-wall: a preset's name, or the path of a YAML file"""
    set: list[str] = field(default_factory=list)
    """Changes of it, each PATH=VALUE"""
    log: str | None = None
    """Path of the run's log; None: none is kept"""
    radians: bool = False
    """Positions in rad; else in degrees, as lerobot's arms take them"""
    percent: dict[str, list[float]] = field(default_factory=dict)
    """Axes in per cent of a range, as lerobot's grippers are: their positions [rad] at 0 and 100"""
    most_age_s: float = 0.1
    """An older position is an error [s]"""


class HapticWall(Teleoperator):
    """The arm; lerobot finds this class by the name of its configuration."""

    config_class = HapticWallConfig
    name = "haptic_wall"

    def __init__(self, config: HapticWallConfig) -> None:
        super().__init__(config)
        self.config = config
        self.axes = haptic_wall.axes(config.arm, config.set)
        for name, ends in config.percent.items():
            if name not in self.axes or len(ends) != 2 or ends[0] == ends[1]:
                raise ValueError(
                    f"percent: found {name}: {ends}, wanted two positions of one of {self.axes}"
                )
        self._scope = contextlib.ExitStack()
        self._wall: haptic_wall.RunningWall | None = None

    @property
    def action_features(self) -> dict[str, type]:
        return {f"{name}.pos": float for name in self.axes}

    @property
    def feedback_features(self) -> dict[str, type]:
        return {}

    @property
    def is_connected(self) -> bool:
        return self._wall is not None and self._wall.running()

    def connect(self, calibrate: bool = True) -> None:  # noqa: ARG002 - of the interface
        """Start the run; return when every axis has a position, before the walls are on."""
        if self.is_connected:
            raise DeviceAlreadyConnectedError(f"{self} is connected")
        self.disconnect()
        run = haptic_wall.run(self.config.arm, self.config.set, log=self.config.log)
        self._wall = self._scope.enter_context(run)
        self.get_action()

    def get_action(self) -> dict[str, float]:
        """Return the newest positions.

        Raises:
            DeviceNotConnectedError: There are none: the run was never started, has ended, or hangs;
                the message says why.
        """
        if self._wall is None:
            raise DeviceNotConnectedError(f"{self}: call connect() first")
        try:
            positions = self._wall.positions(self.config.most_age_s)
        except haptic_wall.RunError as error:
            raise DeviceNotConnectedError(f"{self}: {error}") from None
        return {f"{name}.pos": self._unit(name, x) for name, x in positions.items()}

    def _unit(self, name: str, position: float) -> float:
        if name in self.config.percent:
            low, high = self.config.percent[name]
            return min(100.0, max(0.0, 100.0 * (position - low) / (high - low)))
        return position if self.config.radians else math.degrees(position)

    def send_feedback(self, feedback: dict[str, float]) -> None:
        raise NotImplementedError(
            "the arm takes no torque from outside; a wall can be moved with RunningWall.set"
        )

    def disconnect(self) -> None:
        """End the run with torque off; without one do nothing.

        lerobot's loops call this after an error too, before they disconnect the follower: so it
        raises nothing.
        """
        if self._wall is not None:
            try:
                logger.info("%s: %s", self, self._wall.report()["stop_reason"])
            except haptic_wall.HapticWallError as error:
                logger.error("%s: %s", self, error)
        self._wall = None
        self._scope.close()

    @property
    def is_calibrated(self) -> bool:
        return True  # signs and offsets are in the configuration

    def calibrate(self) -> None:
        pass

    def configure(self) -> None:
        pass
