"""Watches the motion for oscillation, for overspeed, and for energy that the wall generates."""

from __future__ import annotations

from haptic_wall.controller.detector.settings import WatchSettings
from haptic_wall.controller.detector.watch import Watch
from haptic_wall.controller.laws.passivity_control import PassivityControl
from haptic_wall.controller.laws.wall import Law
from haptic_wall.controller.runtime.gains import Gains
from haptic_wall.controller.runtime.overspeed import DrivenSpeed
from haptic_wall.controller.runtime.safety import Trip
from haptic_wall.controller.runtime.sampler import Sampler
from haptic_wall.hw.servo import Outcome

_OK = Outcome.OK


class MotionWatch:
    """Reacts to the motion on the wall: derating, injected damping, or a trip.

    Args:
        law: The rendered law; only this object sets its ``injected``.
        gains: The present decision.
        watch: The oscillation watch.
        driven: Finds a motion that the torque drives beyond the servo's own speed.
        passivity: Injects damping where the wall generates energy; None: none.
    """

    __slots__ = ("_gains", "_law", "_passivity", "driven", "watch")

    def __init__(
        self,
        law: Law,
        gains: Gains,
        watch: Watch,
        driven: DrivenSpeed,
        passivity: PassivityControl | None,
    ) -> None:
        self._law = law
        self._gains = gains
        self.driven = driven
        self._passivity = passivity
        self.watch = watch
        law.derating = watch.backstop.derating

    def follow_gains(self) -> None:
        """Use the sample age and the injected damping of the present decision."""
        schedule = self._gains.schedule
        self.watch.set_age(schedule.age_ns * 1e-9)
        if self._passivity is not None:
            self._passivity.cap = schedule.allowed.injected

    def change(
        self,
        law: Law,
        position: float,
        settings: WatchSettings,
        moved_by: float,
    ) -> None:
        """Watch the motion on another law from now on.

        Args:
            law: The rendered law.
            position: Position of the shaft [rad].
            settings: As of ``Watch.change``.
            moved_by: As of ``Watch.change``.
        """
        self._law = law
        self.watch.change(settings, moved_by)
        if self._passivity is not None:
            self._passivity.rebase(law.elongation(position))

    def resume(self) -> None:
        """Restart after a pause: the motion before it no longer counts."""
        self.watch.resume()
        if self._passivity is not None:
            self._passivity.restart()

    def update(self, sampler: Sampler, contact: bool, periods: int) -> Trip | None:
        """Take the sample of a tick.

        Args:
            sampler: The sample.
            contact: The shaft is in the wall.
            periods: Periods since the last tick [1].

        Returns:
            Why the run must end; None: it need not.
        """
        watch, law = self.watch, self._law
        watch.passed(periods)
        if sampler.outcome is not _OK:
            return None
        position = sampler.position
        held = law.held
        watch.sample(position, law, sampler.measured_torque)
        trip = None
        if self.driven.too_fast(position, sampler.sampled_ns or 0, watch.commanded, contact, law):
            trip = Trip.OVERSPEED
        elif watch.failed:
            trip = Trip.OSCILLATION
        injected = 0.0
        if self._passivity is not None:
            injected = self._passivity.update(
                position,
                law.elongation(position),
                law.stiffness * law.derating.scale,
                watch.acted - held,
                watch.spanned,
            )
            if watch.outruns(law.stiffness):
                injected = self._passivity.waive()  # a damper may feed the vibration of a link
        law.injected = injected
        return trip
