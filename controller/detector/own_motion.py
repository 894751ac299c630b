"""Runs the backstop on half-cycles and, at a one-sided wall, on contacts."""

from __future__ import annotations

import math
from collections.abc import Callable

from haptic_wall.controller.detector.backstop import Backstop, Phase
from haptic_wall.controller.detector.backstop_settings import BackstopSettings
from haptic_wall.controller.detector.contacts import Contacts
from haptic_wall.controller.detector.evidence import Sighting
from haptic_wall.controller.detector.half_cycles import HalfCycles, Repeated
from haptic_wall.controller.detector.load_hold import LoadHold


class OwnMotion:
    """Gives position and torque to the backstop, and reports the wall's own motion.

    A two-sided wall, and a one-sided one under a steady push, is watched by its half-cycles;
    bouncing off a one-sided wall by its contacts.

    Attributes:
        scale: Of the elastic torque and of its limit [1].
        damping_scale: Of the damping [1].
        hold: The torque that holds a load on a softer wall.
        elongation: As of ``WatchSettings``.
    """

    __slots__ = (
        "_backstop",
        "_bounces",
        "_contacts",
        "_half_cycles",
        "_inside",
        "_side",
        "_still_for",
        "_threshold",
        "damping_scale",
        "elongation",
        "hold",
        "scale",
    )

    def __init__(
        self,
        settings: BackstopSettings,
        bounces: BackstopSettings | None,
        side: int,
        elongation: Callable[[float], float] | None = None,
    ) -> None:
        """Start to watch.

        Args:
            settings: Settings for half-cycles.
            bounces: For contacts; None: the wall is two-sided.
            side: 0: two-sided; +1 or -1: it fills the positions above or below.
            elongation: As of ``WatchSettings``.
        """
        self._side = side
        self.elongation = elongation
        self._threshold = settings.threshold
        tuning = settings.tuning
        self._still_for = tuning.half_cycles.still
        self._half_cycles = HalfCycles(settings.period, settings.position_step, tuning.half_cycles)
        limit = settings.torque_limit
        self.hold = LoadHold(self._half_cycles, limit, tuning.hold, one_sided=side != 0)
        self._backstop = Backstop(settings, self._half_cycles, self.hold)
        self._contacts = Contacts(settings.position_step, tuning.contacts)
        self._bounces = None if bounces is None else Backstop(bounces, self._contacts, self.hold)
        self._inside = True
        self.hold.permitted = elongation is None
        self.scale = self.damping_scale = 1.0

    def update(
        self, away: float, torque: float, span: float, stiffness: float, damping: float = 0.0
    ) -> None:
        """Take a sample.

        Args:
            away: Position, counted from that of the wall [rad].
            torque: Sent with the last sample [N·m].
            span: Time since the last sample [s].
            stiffness: K without this object's scale [N·m/rad].
            damping: B without this object's scale [N·m·s/rad].
        """
        backstop, bounces = self._backstop, self._bounces
        backstop.damping = damping
        ended = self._half_cycles.update(away, torque, span)
        if backstop.suspected and self._still and not self.answering:
            self._suspect(False)  # the suspected motion is over, and the next one needs no probe
        if bounces is None:
            elongation = away if self.elongation is None else self.elongation(away)
            backstop.update(span, elongation, stiffness, ended=ended)
            self.scale, self.damping_scale = backstop.stiffness_scale, backstop.damping_scale
            self._follow_load(away, torque, span, stiffness, ended=ended)
            return
        depth = away * self._side
        elongation = away if depth > 0.0 else 0.0
        if depth <= 0.0:  # a half-cycle with a part outside is no evidence about the spring
            self._inside = False
            self._half_cycles.known = 0
        whole = ended and self._inside
        if ended:
            self._inside = depth > 0.0
        backstop.update(span, elongation, stiffness, ended=whole)
        left = self._contacts.update(depth, torque * self._side, span)
        bounces.damping = damping
        bounces.update(span, elongation, stiffness, ended=left)
        if backstop.suspected != bounces.suspected:  # one of them has found the answer
            self._suspect(False)
        self.scale = min(backstop.stiffness_scale, bounces.stiffness_scale)
        self.damping_scale = min(backstop.damping_scale, bounces.damping_scale)
        self._follow_load(away, torque, span, stiffness, ended=whole)

    def _follow_load(
        self, away: float, torque: float, span: float, stiffness: float, *, ended: bool
    ) -> None:
        """Hold the load as it is now, except in a probe; nothing on the whole wall.

        Args:
            away: Position, counted from the wall's surface [rad].
            torque: Sent with the last sample [N·m].
            span: Time since the last sample [s].
            stiffness: K without this object's scale [N·m/rad].
            ended: A half-cycle has ended inside of the wall.
        """
        hold, bounces = self.hold, self._bounces
        hold.whole = self.scale == 1.0
        if hold.whole:
            hold.drop()
            return
        phases = self._backstop.phase, Phase.WATCHING if bounces is None else bounces.phase
        if Phase.PROBING not in phases:
            returning = Phase.RETURNING in phases
            hold.follow(away, torque, span, stiffness, self.scale, ended=ended, returning=returning)

    def is_faster(self, half_cycle: float) -> bool:
        """Whether the shaft turns around sooner than a half-cycle of this length [s]."""
        motion = self._half_cycles
        return motion.known > 1 and motion.interval < half_cycle and motion.elapsed < half_cycle

    def suspect(self) -> None:
        """Request a probe of this motion, regular or not; cancelled if it stops before."""
        self._suspect(True)

    def _suspect(self, suspected: bool) -> None:
        self._backstop.suspected = suspected
        if self._bounces is not None:
            self._bounces.suspected = suspected

    @property
    def _still(self) -> bool:
        """Whether no turning point comes any more, inside the wall or outside."""
        motion = self._half_cycles
        return motion.elapsed > self._still_for * motion.interval > 0.0

    @property
    def suspected(self) -> bool:
        """Whether a suspicion is still open."""
        return self._backstop.suspected or (self._bounces is not None and self._bounces.suspected)

    def raise_again(self) -> None:
        """Restore the gains, as soon as the spring is at rest."""
        self._backstop.raise_again()
        if self._bounces is not None:
            self._bounces.raise_again()

    def resume(self) -> None:
        """Restart the watch after a pause; reductions stay."""
        self._half_cycles.forget()
        self._contacts.known = self._contacts.gaining = 0
        self._suspect(False)
        self._backstop.resume()
        if self._bounces is not None:
            self._bounces.resume()

    def shift(self, way: float) -> None:
        """Go on at a law that has moved: positions count from its new one.

        Args:
            way: Of the law [rad].
        """
        self._half_cycles.shift(way)
        self._contacts.shift(way * self._side)

    def become(
        self,
        bounces: BackstopSettings | None,
        side: int,
        elongation: Callable[[float], float] | None,
    ) -> None:
        """Go on with the motion at another law; what was seen of it stays.

        Args:
            bounces: As of the class.
            side: As of the class.
            elongation: As of ``WatchSettings``.
        """
        self.elongation = elongation
        self.hold.permitted = elongation is None
        if side == self._side:
            return
        self._side, self._inside = side, True
        self.hold.one_sided = side != 0
        self._bounces = None
        if bounces is not None:
            self._contacts = Contacts(bounces.position_step, bounces.tuning.contacts)
            self._bounces = Backstop(bounces, self._contacts, self.hold)

    @property
    def alarm(self) -> bool:
        """Whether the wall feeds the motion."""
        return self._backstop.alarm or (self._bounces is not None and self._bounces.alarm)

    @property
    def steady(self) -> bool:
        """Whether the motion is more regular than a hand's."""
        return self._backstop.steady

    @property
    def failed(self) -> bool:
        """Whether reducing the wall does not help."""
        return self._backstop.failed or (self._bounces is not None and self._bounces.failed)

    @property
    def reduced(self) -> tuple[float, float]:
        """Return the scales of stiffness and damping, without those of a probe that goes on."""
        both = [self._backstop] if self._bounces is None else [self._backstop, self._bounces]
        taken = [one for one in both if one.phase != Phase.PROBING]
        return (
            min((one.stiffness_scale for one in taken), default=1.0),
            min((one.damping_scale for one in taken), default=1.0),
        )

    @property
    def answering(self) -> bool:
        """Whether the wall is being probed, reduced, or restored."""
        bounces = self._bounces
        return self._backstop.phase != Phase.WATCHING or (
            bounces is not None and bounces.phase != Phase.WATCHING
        )

    @property
    def probing(self) -> bool:
        """Whether a probe is under way."""
        bounces = self._bounces
        return self._backstop.phase == Phase.PROBING or (
            bounces is not None and bounces.phase == Phase.PROBING
        )

    @property
    def backlash(self) -> bool:
        """Whether the last alarm was most likely about a limit cycle of backlash."""
        return self._backstop.backlash

    @property
    def moved(self) -> int:
        """Return the number of probes that found a hand."""
        moved = self._backstop.moved
        return moved if self._bounces is None else moved + self._bounces.moved

    @property
    def counts(self) -> tuple[int, int, int, int]:
        """Return the numbers of probes, hands found, alarms, and alarms taken back."""
        one, other = self._backstop, self._bounces
        if other is None:
            return one.probes, one.moved, one.reductions, one.returned
        return (
            one.probes + other.probes,
            one.moved + other.moved,
            one.reductions + other.reductions,
            one.returned + other.returned,
        )

    @property
    def motion(self) -> Repeated:
        """Return the contacts if they raised the alarm, else the half-cycles."""
        bounces = self._bounces
        return self._contacts if bounces is not None and bounces.alarm else self._half_cycles

    @property
    def asked(self) -> Sighting | None:
        """Return the motion on the whole wall that has led to the reduction.

        None: the wall is not reduced, or because of its contacts.
        """
        one, other = self._backstop, self._bounces
        reduced = one.alarm and one.phase == Phase.REDUCED
        return one.asked if reduced and not (other is not None and other.alarm) else None

    @property
    def frequency_hz(self) -> float:
        """Return the frequency of the motion [Hz]; NaN: not known."""
        motion = self.motion
        if motion is self._half_cycles:
            cycle = motion.duration + motion.duration_2
        else:
            cycle = motion.interval
        return 1.0 / cycle if motion.known > 1 and cycle > 0.0 else math.nan

    @property
    def amplitude(self) -> float:
        """Return the amplitude of the motion [rad]."""
        motion = self.motion
        return 0.5 * (motion.amplitude + motion.amplitude_2)
