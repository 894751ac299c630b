"""The backstop: detects self-sustained oscillation by a probe of the wall, and reduces its gains.

A motion that does not decay may be fed by the wall, or made by a hand. The motion alone does not
show which; a change of the wall does. So the wall is probed: at a turning point the elastic torque,
the limit of that torque, and the damping are all reduced to a quarter. A motion that the wall makes
then becomes slower: twice as slow for a linear spring. A hand's motion keeps its period. The result
uses no belief about the servo.

Several axes have a backstop each. A motion of the arm shows in many of them, and the part of its
energy in each spring depends on the pose. So all walls are probed and reduced together: the motion
then becomes twice as slow whatever the pose, like that of one servo. One probe goes on at a time.

The phase of the wall decides what follows the end of a half-cycle or contact. The axis whose motion
is suspected *asks*, the others wait for its answer.

- *Whole*: a motion that does not decay is suspected, and the axis asks (``_suspect``).
- *Probed*: the axis that asks takes the verdict of the probe (``_answer``); another one may learn
  that a hand moves it (``_listen``).
- *Reduced*: the axis that asks judges whether its motion dies, needs softer walls, or must end the
  run (``_judge``); when it has died, another motion may take its place (``_go_on_with``).
- *Returning*: until its spring is at rest, then the wall is whole again.
"""

from __future__ import annotations

import math
from typing import Final

from haptic_wall.controller.detector.motions import BOUNCED, ENDED, THROWN, Motions
from haptic_wall.controller.detector.probe import Probe, Verdict
from haptic_wall.controller.detector.reduction import Cause, Course, Reduction
from haptic_wall.controller.detector.regularity import (
    NEVER,
    Regularity,
    Sighting,
    beyond_hands,
    sighting,
)
from haptic_wall.controller.detector.settings import WatchSettings
from haptic_wall.controller.detector.soft_wall import Phase, SoftWall
from haptic_wall.controller.detector.tuning import TUNING

_WHOLE: Final = Phase.WHOLE  # looking up an enum member is slow


class Shared:
    """What the backstops of a run share.

    Attributes:
        axes: All of them.
        asking: The one whose motion is probed, or has led to the reduction.
        reduction: That of all walls.
    """

    def __init__(self) -> None:
        """Start without an axis."""
        self.axes: list[Backstop] = []
        self.asking: Backstop | None = None
        self.reduction = Reduction()

    def let_return(self) -> None:
        """Let each wall return as soon as its spring is at rest."""
        for axis in self.axes:
            axis.wall.let_return()


class Backstop:
    """Finds persisting motion of an axis, and has all walls probed and reduced.

    Attributes:
        motions: What it sees of the shaft.
        wall: The wall that it softens.
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
        self.motions = Motions(settings)
        self.wall = SoftWall(self.motions.half_cycles, settings)
        self._asked = self.motions.swings
        self._probe = Probe()
        self._time = 0.0
        self.alarm = self.failed = self.news = False
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
        wall = self.wall
        wall.take(away, torque, stiffness, damping)
        news = self.motions.update(away, torque, span)
        if wall.phase is not _WHOLE:
            self.news = True
            self._answer_time(span)
        if news:
            self.news = True
            self._take(news)
        if wall.derating.scale != 1.0 and wall.phase != Phase.PROBED:
            wall.follow(span, ended=bool(news & ENDED))

    def _take(self, news: int) -> None:
        """Process the news of the motions."""
        motions = self.motions
        for which, seen in ((ENDED, motions.swings), (BOUNCED, motions.bounces)):
            if news & which and seen.motion.last:  # else a load that has just gone made it
                self._ended(seen)
        if news & THROWN and self.wall.phase == _WHOLE:
            self._probe_what_throws()

    def _answer_time(self, span: float) -> None:
        """Answer what takes no half-cycle: rest, and a load that has gone.

        Args:
            span: Time since the last sample [s].
        """
        wall = self.wall
        if wall.phase != Phase.REDUCED:
            self.probed_s += span
        gone = wall.loses_load()
        if gone and wall.phase == Phase.PROBED and self._asks:
            self._answer(Verdict.HAND if wall.inside else Verdict.CHANGED)
        if wall.phase == Phase.RETURNING:
            if wall.returns():
                self.motions.forget_throws()  # these began on a softer wall
        elif self._asks:
            motion = self._asked.motion
            if wall.phase == Phase.PROBED:
                if self._probe.still(self._asked):
                    self._stopped()
            elif motion.elapsed > TUNING.still * motion.interval:
                self._died()

    @property
    def steady(self) -> bool:
        """Whether the motion is more regular than a hand's; or regular, and must not be probed."""
        swings, bounces = self.motions.swings, self.motions.bounces
        if swings.steady or self._settings.acts:
            return swings.steady
        threshold, enough = self._settings.threshold, self._settings.regular_long
        return any(one.streak >= enough and one.size >= threshold for one in (swings, bounces))

    @property
    def seen(self) -> Sighting | None:
        """Return the motion: that on the whole wall which has led to the reduction, if it is one.

        None: no cycle is known.
        """
        if self.alarm and self.wall.phase == Phase.REDUCED:
            return self._probe.before
        last = self._asked.motion.last if self.alarm else self.motions.half_cycles.last
        return sighting(last, self._time) if len(last) > 1 else None

    def raise_again(self) -> None:
        """Restore the gains as soon as the spring is at rest, and restart the watch."""
        self._shared.let_return()
        self._probe.forget()
        self.alarm = False
        self.news = True
        self.motions.swings.streak = self.motions.bounces.streak = 0

    def resume(self) -> None:
        """Restart the watch after a pause without torque; reductions stay."""
        self.motions.forget()
        if self._asks:
            self._shared.reduction.count = 0
        self.alarm = False
        self.news = True
        self.wall.drop()
        if self.wall.phase == Phase.PROBED:
            self._shared.let_return()

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
    def _alone(self) -> bool:
        """Whether the run has no other axis."""
        return len(self._shared.axes) == 1

    @property
    def _asks(self) -> bool:
        """Whether the walls are soft because of this axis."""
        return self._shared.asking is self

    def _ended(self, seen: Regularity) -> None:
        """Process the end of a half-cycle or contact."""
        seen.take(self._time)
        phase = self.wall.phase
        if phase == _WHOLE:
            self._suspect(seen)
            return
        if phase == Phase.REDUCED:
            self._go_on_with(seen)
        if seen is not self._asked:
            return
        if phase == Phase.RETURNING:
            if seen.steady and seen.size >= self._settings.threshold:
                self._probe.take_up(seen, self._time)
                self._alarm(Cause.BEYOND_HANDS)  # the wall still waits for its spring to be at rest
        elif not self._asks:
            if phase == Phase.PROBED:
                self._listen(seen)
        elif phase == Phase.PROBED:
            self._answer(self._probe.ended(seen, self._time))
        else:
            self._judge(seen)

    def _suspect(self, seen: Regularity) -> None:
        """React to a motion on the whole wall that does not decay: alarm, probe, or wait."""
        settings, probe = self._settings, self._probe
        if not (seen.suspect or (not self._alone and seen.beats(self.wall.stiffness))):
            self.alarm = self.alarm and seen is not self._asked
            return
        self._asked = seen
        probe.take_up(seen, self._time)
        loaded, large = self._gives_way(0), probe.before.amplitude >= settings.threshold
        if self._certain(seen):
            self._alarm(Cause.BEYOND_HANDS)
            self.failed = settings.acts and loaded
        elif not settings.acts:
            return
        elif loaded:  # a probe would give way to the load
            if large and (seen.steady or seen.streak >= TUNING.regular_long):
                self._alarm(Cause.BEYOND_HANDS)
                self.failed = True
        elif seen.steady and probe.like_hand and large:
            self._alarm(Cause.BEYOND_HANDS)  # a probe found a hand; no hand is so regular
            self.failed = False
        elif not (seen.nearly_steady or self._waits_for_hand(seen)):
            self._ask()

    def _certain(self, seen: Regularity) -> bool:
        """Whether no hand makes this motion: of an arm's joint one at its tip may."""
        large = seen.size >= self._settings.threshold and not seen.contacts
        return self._alone and seen.suspect and large and beyond_hands(seen.motion.last)

    def _waits_for_hand(self, seen: Regularity) -> bool:
        """Whether a probe has just found a hand in such a motion: it seldom goes on so regularly.

        After many regular half-cycles it is probed again.
        """
        if not (self._probe.held_off(self._time) and self._probe.like_hand):
            return False
        return not seen.streak or seen.streak % TUNING.regular_long != 0

    def _probe_what_throws(self) -> None:
        """Probe a wall that returns the shaft faster, contact by contact, regular or not."""
        seen, settings, probe = self.motions.bounces, self._settings, self._probe
        last = seen.motion.last
        if not settings.acts or not last or last[-1].amplitude < settings.small:
            return
        self._asked = seen
        probe.take_up(seen, self._time)
        if not (self._gives_way(0) or (probe.held_off(self._time) and probe.like_hand)):
            self._ask()

    def _gives_way(self, steps: int) -> bool:
        """Whether the load would push through a wall reduced ``steps`` times; 0: in a probe."""
        asked = self._asked
        return self.wall.gives_way(asked.motion.load, steps, contacts=asked.contacts)

    def _ask(self) -> None:
        """Start a probe at a turning point, or after a contact."""
        if not (self.wall.stiffness or self.wall.damping):
            return  # without a torque there is nothing to soften
        self.probes += 1
        self._shared.asking = self
        cycle = self._probe.before.cycle
        for axis in self._shared.axes:
            axis._probe.begin()
            if axis is not self:
                last = axis._asked.motion.last
                axis._probe.before = sighting(last, axis._time) if len(last) > 1 else NEVER
            axis.wall.probe(cycle, moves=axis is self)

    def _listen(self, seen: Regularity) -> None:
        """Find a hand in the probe of another axis: it needs no probe of its own."""
        probe = self._probe
        if probe.before is not NEVER and probe.ended(seen, self._time) == Verdict.HAND:
            probe.found_hand(self._time)

    def _answer(self, verdict: Verdict) -> None:
        """React to the verdict of a probe."""
        if verdict == Verdict.WALL:
            self._alarm(Cause.LONGER)
        elif verdict == Verdict.STOPPED:
            self._stopped()
        elif verdict == Verdict.HAND:
            self.hands += 1
            self._probe.found_hand(self._time)
            self._shared.let_return()
        elif verdict == Verdict.CHANGED:
            self._shared.let_return()

    def _stopped(self) -> None:
        """Process a motion that has stopped in the probe."""
        large = self._probe.before.amplitude >= self._settings.threshold
        if self._probe.stopped(self._time, large=large):
            self._alarm(Cause.STOPPED)
        else:
            self._shared.let_return()

    def _alarm(self, cause: Cause) -> None:
        """Reduce the walls; keep the damping if the probe took longer: the spring is the cause."""
        self.alarms += not self.alarm
        self.alarm = True
        if self._settings.answer != "reduce":
            return  # there is no other answer, or the run ends now
        shared, probe, scale = self._shared, self._probe, TUNING.scale
        small = probe.before.amplitude < self._settings.threshold
        shared.asking = self
        shared.reduction.begin(cause, probe.since, small=small)
        for axis in shared.axes:
            damping = scale if cause == Cause.STOPPED else 1.0
            axis.wall.reduce(scale, damping, moves=axis is self)

    def _go_on_with(self, seen: Regularity) -> None:
        """Judge another motion with the reduced walls from now on, if the last one has died."""
        shared, asking = self._shared, self._shared.asking
        if asking is self:
            if not self.alarm and seen is not self._asked:
                self._asked, shared.reduction.cause = seen, Cause.STOPPED
        elif asking is None or asking.alarm or shared.reduction.count:
            return
        elif seen.size >= self._settings.threshold:
            self._asked, shared.asking = seen, self
            self._probe.take_up(seen, self._time)
            shared.reduction.go_on_with(self._time)

    def _judge(self, seen: Regularity) -> None:
        """Continue to reduce a persisting motion."""
        reduction = self._shared.reduction
        course = reduction.judge(
            seen,
            self._probe.before,
            self._settings,
            self._time,
            softest=self._gives_way(reduction.step),
            slowest=self._slowest,
            alone=self._alone,
        )
        if course == Course.DIED:
            self._died()
        elif course == Course.DIES:
            self.alarm = False
        elif course != Course.OPEN:
            self.alarm = True
            self.failed = course == Course.END
            if course == Course.SOFTEN:
                self._soften_further()

    def _soften_further(self) -> None:
        """Take the next step of the reduction; the damping follows one step behind."""
        reduction, scale = self._shared.reduction, TUNING.scale
        self.wall.hold(moves=True)
        for axis in self._shared.axes:
            axis.wall.reduce(scale ** (reduction.step + 1), scale**reduction.step, moves=False)
        reduction.further()

    @property
    def _slowest(self) -> float:
        """Return the period of the slowest motion at K [s]; with links nobody knows it."""
        stiffness = self.wall.stiffness
        if not self._alone or stiffness <= 0.0:
            return math.inf
        return math.tau * math.sqrt(self._settings.heavy / stiffness)

    def _died(self) -> None:
        """Process the rest of the reduced wall."""
        self.alarm = False
        self._shared.reduction.restart(self._time)
