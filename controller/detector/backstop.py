"""The backstop: detects self-sustained oscillation by a probe of the wall, and reduces its gains.

A motion that does not decay may be fed by the wall, or made by a hand. The motion alone does not
show which; a change of the wall does. So the wall is probed: at a turning point the elastic torque,
the limit of that torque, and the damping are all reduced to a quarter. A motion that the wall makes
then becomes slower: twice as slow for a linear spring. A hand's motion keeps its period. The result
uses no belief about the servo.

Several axes have a backstop each. A motion of the arm shows in many of them, and the part of its
energy in each spring depends on the pose. So all walls are probed and reduced together: the motion
then becomes twice as slow whatever the pose, like that of one servo. One probe goes on at a time.
"""

from __future__ import annotations

import math
from enum import IntEnum
from typing import Final

from haptic_wall.controller.detector.motions import BOUNCED, ENDED, THROWN, Motions
from haptic_wall.controller.detector.probe import Probe, Verdict, alike
from haptic_wall.controller.detector.regularity import (
    NEVER,
    Regularity,
    Sighting,
    apart,
    beyond_hands,
    lasts,
    saturates,
    sighting,
)
from haptic_wall.controller.detector.settings import WatchSettings
from haptic_wall.controller.detector.soft_wall import SoftWall


class Phase(IntEnum):
    """The state of the backstop."""

    WATCHING = 0
    PROBING = 1
    REDUCED = 2
    RETURNING = 3
    """The gains return as soon as the wall's spring is at rest."""


_WATCHING: Final = Phase.WATCHING  # looking up an enum member is slow


class Cause(IntEnum):
    """Why the wall was reduced."""

    LONGER = 0
    """A half-cycle became longer in the probe."""
    STOPPED = 1
    """The motion stopped in the probe, returned, and stopped again."""
    BEYOND_HANDS = 2
    """No hand moves a shaft so fast, so sharply, or so regularly."""


class Shared:
    """What the backstops of a run share.

    Attributes:
        axes: All of them.
        asking: The one whose motion is probed, or has led to the reduction.
    """

    def __init__(self) -> None:
        """Start without an axis."""
        self.axes: list[Backstop] = []
        self.asking: Backstop | None = None


class Backstop:
    """Finds persisting motion, probes the wall, reduces it, and gives up if that fails.

    Attributes:
        motions: What it sees of the shaft.
        wall: The wall that it softens.
        phase: Its state.
        alarm: The wall feeds the motion.
        failed: Reducing does not help: the run must end.
        news: Since its reader has set it to False, what it says of the motion may have changed.
        probes: Number of probes.
        probed_s: Time with a softer wall in probes, and after them until it came back [s].
        hands: Number of probes that found a hand.
        alarms: Number of alarms.
    """

    def __init__(self, settings: WatchSettings, shared: Shared | None = None) -> None:
        """Start to watch the whole wall; ``shared``: with the other axes of the run."""
        self._settings = settings
        self._shared = shared or Shared()
        self._shared.axes.append(self)
        self._tuning = settings.tuning
        self.motions = Motions(settings)
        self.wall = SoftWall(self.motions.half_cycles, settings)
        self._asked = self.motions.swings
        self.probe = Probe(settings.tuning)
        self.phase, self._cause = Phase.WATCHING, Cause.STOPPED
        self._time = self._begun = 0.0
        self._stops = self._count = self._step = 0
        self._hand = self._stop = NEVER
        self.alarm = self.failed = False
        self._small_cycle = self.news = False
        self.probes = self.hands = self.alarms = 0
        self.probed_s = 0.0

    def update(
        self, away: float, torque: float, span: float, stiffness: float, damping: float = 0.0
    ) -> None:
        """Take a sample.

        Args:
            away: Position, counted from that of the wall [rad].
            torque: Sent with the last sample [N·m].
            span: Time since the last sample [s].
            stiffness: K without the derating [N·m/rad].
            damping: B without the derating [N·m·s/rad].
        """
        self._time += span
        self.wall.take(away, torque, stiffness, damping)
        news = self.motions.update(away, torque, span)
        if self.phase is not _WATCHING:
            self.news = True
            self._answer_time(span)
        if news:
            self.news = True
            self._take(news)
        if self.wall.derating.scale != 1.0 and self.phase != Phase.PROBING:
            returning = self.phase == Phase.RETURNING
            self.wall.follow(span, ended=bool(news & ENDED), returning=returning)

    def _take(self, news: int) -> None:
        """Process the news of the motions."""
        motions = self.motions
        for which, seen in ((ENDED, motions.swings), (BOUNCED, motions.bounces)):
            if news & which and seen.motion.last:  # else a load that has just gone made it
                self._ended(seen)
        if news & THROWN and self.phase == Phase.WATCHING:
            self._probe_what_throws()

    def _answer_time(self, span: float) -> None:
        """Answer what takes no half-cycle: rest, and a load that has gone.

        Args:
            span: Time since the last sample [s].
        """
        if self.phase != Phase.REDUCED:
            self.probed_s += span
        gone = self.wall.loses_load(soft=self.phase == Phase.REDUCED)
        if gone and self.phase == Phase.PROBING and self._asks:
            self._answer(Verdict.HAND if self.wall.inside else Verdict.CHANGED)
        if self.phase == Phase.RETURNING:
            if self.wall.returns():
                self.phase = Phase.WATCHING
                self.motions.forget_throws()  # these began on a softer wall
        elif self._asks:
            motion = self._asked.motion
            if self.phase == Phase.PROBING:
                if self.probe.still(self._asked):
                    self._stopped()
            elif motion.elapsed > self._tuning.still * motion.interval:
                self._died()

    @property
    def steady(self) -> bool:
        """Whether the motion is more regular than a hand's; or regular, and must not be probed."""
        swings, bounces = self.motions.swings, self.motions.bounces
        if swings.steady or self._settings.acts:
            return swings.steady
        threshold, enough = self._settings.threshold, self._tuning.regular_long
        return any(one.streak >= enough and one.size >= threshold for one in (swings, bounces))

    @property
    def reduced(self) -> tuple[float, float]:
        """Return the scales of stiffness and damping, without those of a probe that goes on."""
        if self.phase == Phase.PROBING:
            return 1.0, 1.0
        return self.wall.derating.scale, self.wall.derating.damping_scale

    @property
    def seen(self) -> Sighting | None:
        """Return the motion: that on the whole wall which has led to the reduction, if it is one.

        None: no cycle is known.
        """
        if self.alarm and self.phase == Phase.REDUCED:
            return self.probe.before
        last = self._asked.motion.last if self.alarm else self.motions.half_cycles.last
        return sighting(last, self._time) if len(last) > 1 else None

    def raise_again(self) -> None:
        """Restore the gains as soon as the spring is at rest, and restart the watch."""
        self._let_return()
        self.alarm = self._small_cycle = False
        self.news = True
        self._hand = self._stop = NEVER
        self.motions.swings.streak = self.motions.bounces.streak = 0

    def resume(self) -> None:
        """Restart the watch after a pause without torque; reductions stay."""
        self.motions.forget()
        self._count = 0
        self.alarm = False
        self.news = True
        self.wall.drop()
        if self.phase == Phase.PROBING:
            self._let_return()

    def change(self, settings: WatchSettings, moved_by: float) -> None:
        """Go on with the motion at another law; what was seen of it stays.

        Args:
            settings: Settings of the law.
            moved_by: Way from the position of the law before [rad].
        """
        bounces = self._asked.contacts
        self._settings = settings
        self.news = True
        self.wall.change(settings)
        self.motions.change(settings, moved_by)
        if bounces:
            self._asked = self.motions.bounces

    @property
    def _asks(self) -> bool:
        """Whether the walls are soft because of this axis."""
        return self._shared.asking is self

    def _let_return(self) -> None:
        """Let each wall return as soon as its spring is at rest."""
        for axis in self._shared.axes:
            axis.phase = Phase.RETURNING

    def _ended(self, seen: Regularity) -> None:
        """Process the end of a half-cycle or contact."""
        seen.take(self._time)
        phase = self.phase
        if phase == Phase.WATCHING:
            self._watch(seen)
            return
        if phase == Phase.REDUCED:
            self._go_on_with(seen)
        if seen is not self._asked:
            return
        if phase == Phase.RETURNING:
            if seen.steady and seen.size >= self._settings.threshold:
                self._take_up(seen)
                self._alarm(Cause.BEYOND_HANDS)  # the wall still waits for its spring to be at rest
        elif not self._asks:
            self._listen(seen)
        elif phase == Phase.PROBING:
            self._answer(self.probe.ended(seen, self._time))
        else:
            self._judge(seen)

    def _listen(self, seen: Regularity) -> None:
        """Find a hand in the probe of another axis: it needs no probe of its own."""
        if self.phase != Phase.PROBING or self.probe.before is NEVER:
            return
        if self.probe.ended(seen, self._time) == Verdict.HAND:
            self._hand = self.probe.before._replace(at=self._time)

    def _go_on_with(self, seen: Regularity) -> None:
        """Judge another motion with the reduced walls from now on, if the last one has died."""
        asking = self._shared.asking
        if asking is self:
            if not self.alarm and seen is not self._asked:
                self._asked, self._cause = seen, Cause.STOPPED
        elif asking is None or asking.alarm or asking._count:
            return
        elif seen.size >= self._settings.threshold:
            self._asked, self._cause = seen, Cause.STOPPED
            self._begun, self._count, self._step = self._time, 0, asking._step
            self.probe.before = sighting(seen.motion.last, self._time)
            self._small_cycle = False
            self._shared.asking = self

    def _watch(self, seen: Regularity) -> None:
        """React to a motion that does not decay: alarm, probe, or wait."""
        settings, last = self._settings, seen.motion.last
        large = seen.size >= settings.threshold
        regular = seen.steady
        if large:
            saturated = saturates(last, settings.torque_limit, self._tuning)
            regular = seen.repeats or saturated
        if regular and seen.motion.gain > self._tuning.least_gain:
            beyond = large and not seen.contacts and beyond_hands(last, self._tuning)
            self._consider(seen, beyond=beyond)
        elif seen is self._asked:
            self.alarm = False

    def _take_up(self, seen: Regularity) -> None:
        """Store the motion on the whole wall, before an alarm or a probe."""
        self._asked = seen
        self._begun = seen.since
        self.probe.before = sighting(seen.motion.last, self._time)

    def _consider(self, seen: Regularity, *, beyond: bool) -> None:
        """Decide how to react to a regular motion that does not decay.

        Args:
            seen: The motion.
            beyond: No hand makes it.
        """
        settings, tuning = self._settings, self._tuning
        self._take_up(seen)
        large = self.probe.before.amplitude >= settings.threshold
        loaded = self._gives_way(0)
        if beyond:
            self._alarm(Cause.BEYOND_HANDS)
            self.failed = settings.acts and loaded
        elif not settings.acts:
            return
        elif loaded:
            if large and (seen.steady or seen.streak >= tuning.regular_long):
                self._alarm(Cause.BEYOND_HANDS)
                self.failed = True  # a softer wall would give way
        elif seen.steady and self._made_by_hand() and large:
            self._alarm(Cause.BEYOND_HANDS)  # a probe took it for a hand's; no hand is so regular
        elif seen.nearly_steady:
            return
        elif self._held_off() and self._made_by_hand():
            if seen.streak and seen.streak % tuning.regular_long == 0:
                self._ask()  # a hand seldom goes on so regularly
        else:
            self._ask()

    def _probe_what_throws(self) -> None:
        """Probe a wall that returns the shaft faster, contact by contact, regular or not."""
        seen, settings = self.motions.bounces, self._settings
        last = seen.motion.last
        if not settings.acts or not last or last[-1].amplitude < settings.small:
            return
        self._take_up(seen)
        if self._held_off() and self._made_by_hand():
            return
        if not self._gives_way(0):
            self._ask()

    def _made_by_hand(self) -> bool:
        """Whether the last hand that a probe found made a motion like this."""
        hand, now = self._hand, self.probe.before
        return (
            hand is not NEVER
            and apart(now.cycle, hand.cycle) < self._tuning.other_period
            and now.amplitude < self._tuning.other_amplitude * hand.amplitude
        )

    def _held_off(self) -> bool:
        """Whether a probe found a hand not long ago."""
        return self._time - self._hand.at < self._tuning.held_off_s

    def _gives_way(self, steps: int) -> bool:
        """Whether the load would push through a wall reduced ``steps`` times; 0: in a probe."""
        load, limit = abs(self._asked.motion.load), self._settings.torque_limit
        tuning = self._tuning
        if self.wall.permitted and not self._asked.contacts:
            return load > tuning.loaded * limit
        return load > tuning.loaded_contacts * tuning.scale**steps * limit

    def _ask(self) -> None:
        """Start a probe at a turning point, or after a contact."""
        if not (self.wall.stiffness or self.wall.damping):
            return  # without a torque there is nothing to soften
        self.probes += 1
        self._shared.asking = self
        self.probe.begin()
        cycle = self.probe.before.cycle
        for axis in self._shared.axes:
            axis.phase = Phase.PROBING
            if axis is not self:
                axis._prepare_to_listen()
            axis.wall.soften_for(cycle, moves=axis is self)

    def _prepare_to_listen(self) -> None:
        """Store the motion before the probe of another axis."""
        last = self._asked.motion.last
        self.probe.begin()
        self.probe.before = sighting(last, self._time) if len(last) > 1 else NEVER

    def _answer(self, verdict: Verdict) -> None:
        """React to the verdict of a probe."""
        if verdict == Verdict.WALL:
            self._alarm(Cause.LONGER)
        elif verdict == Verdict.STOPPED:
            self._stopped()
        elif verdict == Verdict.HAND:
            self.hands += 1
            self._hand = self.probe.before._replace(at=self._time)
            self._let_return()
        elif verdict == Verdict.CHANGED:
            self._let_return()

    def _stopped(self) -> None:
        """Process a motion that has stopped in the probe.

        It was the wall's if it returns and stops again.
        """
        before, tuning = self.probe.before, self._tuning
        recent = self._time - self._stop.at < tuning.again_s
        again = recent and alike(before, self._stop, tuning)
        self._stops = self._stops + 1 if recent else 1
        large = before.amplitude >= self._settings.threshold
        if again or (self._stops >= tuning.stops and large):
            self._stops = 0
            self._alarm(Cause.STOPPED)
            return
        self._stop = before._replace(at=self._time)
        self._let_return()

    def _alarm(self, cause: Cause) -> None:
        """Reduce the wall; keep the damping if the probe took longer: the spring is the cause."""
        settings = self._settings
        self.alarms += not self.alarm
        self.alarm = True
        self._small_cycle = self.probe.before.amplitude < settings.threshold
        if not settings.acts:
            return
        self._cause = cause
        self._shared.asking = self
        self._step, self._count = 1, 0
        scale = self._tuning.scale
        for axis in self._shared.axes:
            if axis.phase == Phase.WATCHING:
                axis.wall.hold(moves=axis is self)
            axis.phase = Phase.REDUCED
            axis.wall.scale(scale, scale if cause == Cause.STOPPED else 1.0)

    def _judge(self, seen: Regularity) -> None:
        """Continue to reduce a persisting motion."""
        settings, tuning = self._settings, self._tuning
        last, size = seen.motion.last, seen.size
        self._count += 1
        if size < (settings.small if self._small_cycle else settings.threshold):
            self._died()
            return
        if self._count < 2 or len(last) < 4:
            return
        shrinks = last[3].amplitude < tuning.dying * last[1].amplitude
        if shrinks and last[2].amplitude <= last[0].amplitude:
            self.alarm = False
            return
        large = size >= settings.threshold
        if self._small_cycle and large:
            self._small_cycle = False  # it has become a large motion, whose time begins now
            self._begun = self._time
        if self._small_cycle and not (lasts(last, tuning) and self._count >= tuning.steady):
            return
        self.alarm = True
        softest = self._step >= tuning.steps or self._gives_way(self._step)
        late = not seen.contacts and self._time - self._begun > min(
            tuning.cycles * self._slowest, tuning.longest_s
        )
        if large and (softest or late) and self._own(seen):
            if self._count >= tuning.reduced_half_cycles:
                self.failed = not seen.contacts or seen.motion.gain > tuning.reduced_gain
        elif not softest:
            self._soften_further()

    def _soften_further(self) -> None:
        """Take the next step of the reduction; the damping follows one step behind."""
        self.wall.hold(moves=True)
        scale = self._tuning.scale
        for axis in self._shared.axes:
            axis.wall.scale(scale ** (self._step + 1), scale**self._step)
        self._step += 1
        self._count = 0

    def _own(self, seen: Regularity) -> bool:
        """Whether the wall certainly makes this motion."""
        if self._cause == Cause.STOPPED:
            return seen.steady
        last, tuning = seen.motion.last, self._tuning
        inertia, before = sighting(last, self._time).inertia, self.probe.before.inertia
        explained = tuning.lightest_probed * before < inertia < tuning.heaviest_probed * before
        if self._cause == Cause.LONGER:
            return explained and seen.streak > 0
        return explained or seen.steady or (not seen.contacts and beyond_hands(last, tuning))

    @property
    def _slowest(self) -> float:
        """Return the period of the slowest motion at K [s]; with links nobody knows it."""
        stiffness = self.wall.stiffness
        if len(self._shared.axes) > 1 or stiffness <= 0.0:
            return 1e9
        return math.tau * math.sqrt(self._settings.heavy / stiffness)

    def _died(self) -> None:
        """Process the rest of the reduced wall; the next motion has its own time and evidence."""
        self.alarm = False
        self._begun = self._time
        self._count = 0
