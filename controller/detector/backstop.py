"""The backstop: detects self-sustained oscillation by a probe of the wall, and reduces its gains.

A motion that does not decay may be fed by the wall, or made by a hand. The motion alone does not
show which; a change of the wall does. So the wall is probed: at a turning point the elastic torque,
the limit of that torque, and the damping are all reduced to a quarter. A motion that the wall makes
then becomes slower: twice as slow for a linear spring. A hand's motion keeps its period. The result
uses no belief about the servo.
"""

from __future__ import annotations

import math
from enum import IntEnum

from haptic_wall.controller.detector.backstop_settings import BackstopSettings
from haptic_wall.controller.detector.evidence import (
    NEVER,
    Sighting,
    alike,
    beyond_hands,
    explains,
    is_limit_cycle,
    lasts,
    saturates,
    sighting,
)
from haptic_wall.controller.detector.half_cycles import Repeated
from haptic_wall.controller.detector.known_hand import KnownHand
from haptic_wall.controller.detector.load_hold import LoadHold
from haptic_wall.controller.detector.persistence import Persistence
from haptic_wall.controller.detector.probe import Probe, Verdict


class Phase(IntEnum):
    """The state of the backstop."""

    WATCHING = 0
    PROBING = 1
    REDUCED = 2
    RETURNING = 3
    """Back-off: the gains return as soon as the wall's spring is at rest."""


class Cause(IntEnum):
    """Why the wall was reduced."""

    LONGER = 0
    """A half-cycle became longer in the probe."""
    STOPPED = 1
    """The motion stopped in the probe, returned, and stopped again."""
    BEYOND_HANDS = 2
    """No hand moves a shaft so fast, so sharply, or so regularly."""


class Backstop:
    """Finds persisting motion, probes the wall, reduces it, and gives up if that fails.

    Attributes:
        phase: Its state.
        stiffness_scale: Of the elastic torque and of its limit [1].
        damping_scale: Of the damping [1].
        damping: B without this object's scale [N·m·s/rad]; set by the caller.
        alarm: The wall feeds the motion.
        failed: Reducing does not help: the run must end.
        moved: Number of probes that found a hand.
        probes: Number of probes.
        reductions: Number of alarms.
        returned: Number of wrong alarms, whose reduction was undone.
        suspected: The caller has reduced the wall, and asks whether the wall moves the shaft: the
            next motion is probed. May be set at any time.
        small_cycle: The last alarm was about a steady motion below the threshold.
        backlash: The last answered motion was small and neither grew nor saturated the torque: most
            likely a limit cycle of backlash.
    """

    __slots__ = (
        "_asks_again",
        "_begun",
        "_bounce",
        "_cause",
        "_count",
        "_elongation",
        "_evidence",
        "_gaining",
        "_hand",
        "_hold",
        "_lasting",
        "_motion",
        "_probe",
        "_probing",
        "_settings",
        "_settled",
        "_step",
        "_stiffness",
        "_still",
        "_stop",
        "_stops",
        "_time",
        "_tuning",
        "_whole",
        "alarm",
        "backlash",
        "damping",
        "damping_scale",
        "failed",
        "moved",
        "phase",
        "probes",
        "reductions",
        "returned",
        "small_cycle",
        "stiffness_scale",
        "suspected",
    )

    def __init__(
        self, settings: BackstopSettings, motion: Repeated, hold: LoadHold | None = None
    ) -> None:
        """Start to watch.

        Args:
            settings: Thresholds and permitted actions.
            motion: The observed motion; its owner reports each end to ``update``.
            hold: Holds the load while the wall is softer; None: nothing does.
        """
        self._settings = settings
        self._hold = hold
        self._motion = motion
        tuning = settings.tuning
        self._tuning, self._evidence = tuning.backstop, tuning.evidence
        self._probing, self._still = tuning.probe, tuning.half_cycles.still
        self._bounce = tuning.contacts.bounce
        self._lasting = Persistence(settings)
        self._time = self._begun = 0.0
        self._stiffness = self._elongation = self.damping = 0.0
        self._stops = 0
        self._asks_again = False
        self._count = self._step = self._whole = self._gaining = 0
        self._cause = Cause.STOPPED
        self._probe = Probe(settings.threshold, tuning, contacts=settings.bounces)
        self._hand = KnownHand(self._tuning)
        self._stop = NEVER
        self.phase = Phase.WATCHING
        self.stiffness_scale = self.damping_scale = 1.0
        self.alarm = self.failed = self.small_cycle = self.backlash = False
        self._settled = False
        self.suspected = False
        self.moved = self.probes = self.reductions = self.returned = 0

    def update(self, span: float, elongation: float, stiffness: float, *, ended: bool) -> None:
        """Take a sample.

        Args:
            span: Time since the last sample [s].
            elongation: Elongation of the wall's spring, signed [rad].
            stiffness: K without this object's scale [N·m/rad].
            ended: A half-cycle, or a contact, has ended.
        """
        self._time += span
        self._stiffness = stiffness
        phase, last = self.phase, self._elongation
        lets_go = abs(elongation) < abs(last)
        self._elongation = elongation
        hold = self._hold
        if hold is not None and hold.torque and hold.left(elongation, soft=phase == Phase.REDUCED):
            hold.leave()
            if phase == Phase.PROBING:
                self._answer(Verdict.HAND if hold.inside else Verdict.CHANGED)
        if phase == Phase.WATCHING:
            if self.suspected and lets_go and not (ended or self._settings.bounces):
                self._probe_a_suspicion(begun=True)
        elif phase == Phase.PROBING:
            if self._probe.still(self._motion):
                self._stopped()
        elif phase == Phase.RETURNING:
            self._return(elongation, last)
        elif self._motion.elapsed > self._still * self._motion.interval:
            self._died()  # the reduced wall is at rest
        if ended:
            self._ended()
        if self.phase == Phase.WATCHING and self._motion.gaining != self._gaining:
            self._gaining = self._motion.gaining
            if self._gaining >= self._tuning.throws:
                self._probe_what_throws()

    @property
    def steady(self) -> bool:
        """Whether the motion is more regular than a hand's; or regular, and must not be probed."""
        return self._lasting.steady

    @property
    def asked(self) -> Sighting:
        """Return the motion before the last probe or alarm."""
        return self._probe.before

    def _missing(self, elongation: float) -> float:
        """Return the torque by which the whole spring's differs from the present one's [N·m].

        Args:
            elongation: Elongation of the spring [rad].
        """
        missing = (1.0 - self.stiffness_scale) * self._stiffness * elongation
        hold = self._hold
        if hold is not None:
            missing += hold.acts(elongation, self._stiffness, self.stiffness_scale)
        return missing

    def _return(self, elongation: float, last: float) -> None:
        """Restore the gains where that does not change the torque: the spring is at rest there.

        Args:
            elongation: Elongation of the spring [rad].
            last: At the last sample; a fast motion is at rest between two samples [rad].
        """
        missing = self._missing(elongation)
        most = self._settings.rest_torque
        if missing * self._missing(last) < 0.0:
            most *= self._tuning.rest_between
        least = self._tuning.rest_counts * self._settings.position_step
        softer = 1.0 - self.stiffness_scale
        if abs(missing) <= max(most, least * softer * self._stiffness):
            self.stiffness_scale = self.damping_scale = 1.0
            self.phase = Phase.WATCHING
            self._whole = -1  # the present half-cycle began on a softer wall

    def _take_load(self) -> None:
        """Hold the load of the last cycle from now on."""
        if self._hold is not None:
            self._hold.begin(self._stiffness)

    def raise_again(self) -> None:
        """Restore the gains as soon as the spring is at rest, and restart the watch."""
        self.phase = Phase.RETURNING
        self.alarm = self.small_cycle = self.suspected = False
        self._hand.forget()
        self._stop = NEVER
        self._lasting.streak = 0

    def resume(self) -> None:
        """Restart the watch after a pause; reductions stay."""
        self._lasting.streak = self._count = 0
        self.alarm = False
        if self._hold is not None:
            self._hold.drop()
        if self.phase == Phase.PROBING:
            self.phase = Phase.RETURNING

    def _ended(self) -> None:
        """Process the end of a half-cycle or contact."""
        motion, settings = self._motion, self._settings
        self._count += 1
        size = min(motion.amplitude, motion.amplitude_2)
        self._lasting.take(motion, self._time)
        self._whole += 1
        if self.phase == Phase.WATCHING:
            if self.suspected:
                self._probe_a_suspicion(begun=False)
            elif self._asks_again and self._whole > 1:
                self._ask_again(size)
            if self.phase == Phase.WATCHING:
                self._watch(size)
        elif self.phase == Phase.PROBING:
            self._answer(self._probe.ended(motion, sighting(motion, self._time)))
        elif self.phase == Phase.REDUCED:
            self._judge()
        elif self.steady and size >= settings.threshold:
            self._begun = self._lasting.since
            self._probe.before = sighting(motion, self._time)
            self._alarm(Cause.BEYOND_HANDS)  # the wall still waits for its spring to be at rest

    def _watch(self, size: float) -> None:
        """React to a regular motion that does not decay.

        Args:
            size: Smaller amplitude of the last two half-cycles [rad].
        """
        motion, settings = self._motion, self._settings
        if size < settings.threshold:
            regular = self.steady
        else:
            before = min(motion.amplitude_3, motion.amplitude_4)
            even = self._lasting.streak >= self._tuning.regular and before >= settings.threshold
            even = even and not self._lasting.dies
            regular = even or saturates(motion, settings.torque_limit, self._evidence)
        if regular and motion.gain > self._tuning.least_gain:
            self._consider()
        elif size >= settings.threshold and self._goes_on_beyond_hands():
            self._lasting.since = self._time
            self._consider()
        else:
            self.alarm = False

    def _goes_on_beyond_hands(self) -> bool:
        """Whether a motion beyond hands persists."""
        seen = sighting(self._motion, self._time)
        return self._lasting.goes_on(seen.amplitude, beyond_hands=self._beyond_hands(seen))

    def _consider(self) -> None:
        """Decide how to react to a regular motion that does not decay."""
        motion, settings, lasting = self._motion, self._settings, self._lasting
        self._begun = lasting.since
        self._settled = is_limit_cycle(motion, settings.torque_limit, self._evidence)
        self._probe.before = seen = sighting(motion, self._time)
        if self._beyond_hands(seen):
            self._alarm(Cause.BEYOND_HANDS)
            self.failed = settings.acts and self._loaded
        elif not settings.acts:
            return
        elif self._loaded:
            servos = settings.light < seen.inertia < settings.heavy
            own = servos and lasting.streak >= self._tuning.regular_long
            weight = seen.inertia > settings.light and lasting.gentle >= self._tuning.gentle_loaded
            if (self.steady or own or weight) and seen.amplitude >= settings.threshold:
                self._alarm(Cause.BEYOND_HANDS)
                self.failed = True  # a softer wall would give way
        elif self.steady and self._hand.made(seen) and seen.amplitude >= settings.threshold:
            self._alarm(Cause.BEYOND_HANDS)  # a probe took it for a hand's; no hand is so regular
        elif lasting.nearly_steady:
            return
        elif self._hand.holds_off(seen):
            if lasting.streak and lasting.streak % self._tuning.regular_long == 0:
                self._ask(within=False)  # a hand seldom goes on so regularly
        elif (
            self.steady
            or lasting.streak >= self._tuning.regular_unlikely
            or settings.light < seen.inertia < settings.heavy
        ):
            self._ask(within=False)

    def _probe_a_suspicion(self, *, begun: bool) -> None:
        """Probe a motion as soon as the wall is suspected.

        Args:
            begun: A half-cycle has begun some time ago; its length is no evidence.
        """
        motion, settings = self._motion, self._settings
        known = min(motion.known, self._whole)
        if not settings.acts or known < 1 or motion.amplitude < settings.small or self._loaded:
            return
        seen = sighting(motion, self._time)
        if known < 2:
            seen = Sighting(2.0 * motion.duration, motion.amplitude, motion.inertia, self._time)
        if self._hand.recent(seen):
            return
        self._begun = self._time - motion.elapsed - motion.duration
        self._settled = is_limit_cycle(motion, settings.torque_limit, self._evidence)
        self._probe.before = seen
        large = known > 1 and min(motion.amplitude, motion.amplitude_2) >= settings.threshold
        if large and lasts(motion, self._evidence) and self._beyond_hands(seen):
            self._alarm(Cause.BEYOND_HANDS)
            return
        self._ask(within=begun)

    def _ask_again(self, size: float) -> None:
        """Probe a motion once more, after a doubtful answer.

        Args:
            size: Smaller amplitude of the last two half-cycles [rad].
        """
        self._asks_again = False
        if size >= self._settings.threshold and not self._loaded:
            self._probe.before = sighting(self._motion, self._time)
            self._ask(within=False)

    def _probe_what_throws(self) -> None:
        """Probe a wall that returns the shaft faster, contact by contact, regular or not."""
        seen = sighting(self._motion, self._time)
        if (
            not self._settings.acts
            or self._motion.amplitude < self._settings.small
            or self._whole < 2
            or self._hand.holds_off(seen)
        ):
            return
        self._begun = self._lasting.since
        self._settled = False
        self._probe.before = seen
        if not self._loaded:
            self._ask(within=False)
        elif self._gaining >= self._tuning.throws_loaded and self._bounced:
            self._alarm(Cause.BEYOND_HANDS)
            self.failed = True

    @property
    def _bounced(self) -> bool:
        """Whether the last four contacts were as short as bounces."""
        motion = self._motion
        longest = max(motion.duration, motion.duration_2, motion.duration_3, motion.duration_4)
        return longest < 0.5 * self._bounce * self._slowest

    @property
    def _loaded(self) -> bool:
        """Whether the wall holds a load that would push through the probed wall."""
        return self._gives_way(0)

    def _gives_way(self, steps: int) -> bool:
        """Whether the load would push through a wall reduced ``steps`` times."""
        load, limit = abs(self._motion.load), self._settings.torque_limit
        holds = self._hold is not None and self._hold.permitted
        if holds and not self._settings.bounces:
            return load > self._tuning.loaded * limit
        return load > self._tuning.loaded_contacts * self._probing.scale**steps * limit

    @property
    def _softest(self) -> bool:
        """Whether the wall cannot be reduced further, or would give way to its load."""
        return self._step >= self._tuning.steps or self._gives_way(self._step)

    def _beyond_hands(self, seen: Sighting) -> bool:
        pull = min(self._motion.pull, self._motion.pull_2, self._motion.pull_3)
        return not self._settings.bounces and beyond_hands(
            seen.cycle, seen.amplitude, pull, self._evidence
        )

    def _ask(self, *, within: bool) -> None:
        """Start a probe; ``within`` a half-cycle that has begun before."""
        self.phase = Phase.PROBING
        self._asks_again = False
        self.probes += 1
        self._take_load()
        self._probe.begin(self._motion, within=within)
        self.stiffness_scale = self._probing.scale
        # Damping that acts late stiffens the wall by up to B w, and would hide the softer spring.
        # Whole, it slows down a shaft whose load is let go.
        loaded = self._hold is not None and self._hold.torque
        stiffens = self.damping * math.pi > self._stiffness * self._motion.duration
        self.damping_scale = 1.0 if loaded and not stiffens else self._probing.scale

    def _answer(self, verdict: Verdict) -> None:
        """React to the verdict of a probe."""
        if verdict == Verdict.WALL:
            self._alarm(Cause.LONGER)
        elif verdict == Verdict.STOPPED:
            self._stopped()
        elif verdict == Verdict.HAND or (verdict == Verdict.CHANGED and self.suspected):
            self._somebody_moves_it()
        elif verdict in (Verdict.CHANGED, Verdict.DOUBTFUL):
            self.phase = Phase.RETURNING
            self._asks_again = verdict == Verdict.DOUBTFUL

    def _stopped(self) -> None:
        """Process a motion that has stopped in the probe.

        It was the wall's if it returns and stops again.
        """
        before = self._probe.before
        recent = self._time - self._stop.at < self._tuning.again_s
        again = recent and alike(before, self._stop, self._probing)
        self._stops = self._stops + 1 if recent else 1
        many = self._stops >= self._tuning.stops and before.amplitude >= self._settings.threshold
        if again or many:
            self._stops = 0
            self._alarm(Cause.STOPPED)
            return
        self._stop = before._replace(at=self._time)
        if before.amplitude < self._settings.threshold and not self.suspected:
            self.backlash = self._settled  # it was as regular as a machine's
        self.suspected = False
        self.phase = Phase.RETURNING

    def _alarm(self, cause: Cause) -> None:
        """Reduce the wall; keep the damping if the probe took longer: the spring is the cause."""
        self.reductions += not self.alarm
        self.alarm = True
        self.suspected = False
        self.small_cycle = self._probe.before.amplitude < self._settings.threshold
        small = self._probe.before.amplitude < self._tuning.backlash * self._settings.threshold
        self.backlash = small and self._settled
        if not self._settings.acts:
            return
        self._cause = cause
        if self.phase == Phase.WATCHING:
            self._take_load()
        self.phase = Phase.REDUCED
        self._step, self._count = 1, 0
        self.stiffness_scale = self._probing.scale
        self.damping_scale = self._probing.scale if cause == Cause.STOPPED else 1.0

    def _judge(self) -> None:
        """Continue to reduce a persisting motion; restore the gains if a hand makes it."""
        motion, settings = self._motion, self._settings
        size = min(motion.amplitude, motion.amplitude_2)
        if size < (settings.small if self.small_cycle else settings.threshold):
            self._died()
            return
        if self._count < 2:
            return
        shrinks = motion.amplitude < self._evidence.dying * motion.amplitude_3
        if shrinks and motion.amplitude_2 <= motion.amplitude_4:
            self.alarm = False
            return
        if self.small_cycle and size >= settings.threshold:
            self.small_cycle = False  # it has become a large motion, whose time begins now
            self._begun = self._time
        evenly = self._settings.tuning.steadiness.half_cycles
        if self.small_cycle and not (lasts(motion, self._evidence) and self._count >= evenly):
            return
        self.alarm = True
        seen = sighting(motion, self._time)
        if self._hand_after_all(seen):
            self._was_wrong()
        elif size >= settings.threshold and self._own(seen) and self._is_last():
            if self._count >= self._tuning.reduced_half_cycles:
                self.failed = not settings.bounces or motion.gain > self._tuning.reduced_gain
        elif self._softest:
            as_large = seen.amplitude > self._tuning.hand_smallest * self._probe.before.amplitude
            hand = as_large and not (self.small_cycle or self._beyond_hands(seen))
            if hand and self._count >= self._tuning.hand_half_cycles:
                self._was_wrong()
        else:
            self.damping_scale = self._probing.scale**self._step
            self._step += 1
            self._take_load()
            self.stiffness_scale = self._probing.scale**self._step
            self._count = 0

    def _hand_after_all(self, seen: Sighting) -> bool:
        """Whether the motion on the reduced wall is as fast and about as large as a hand's.

        Args:
            seen: The motion now.
        """
        tuning = self._tuning
        ratio = seen.cycle / self._probe.before.cycle
        if self._motion.amplitude < tuning.hand_smallest * self._probe.before.amplitude:
            return False
        least, most = tuning.hand_shortest, tuning.hand_longest
        if self._cause == Cause.LONGER:
            return least < ratio < (most if self._step == 1 else tuning.hand_longest_later)
        return (
            self._cause == Cause.STOPPED
            and not self.steady
            and self._lasting.streak >= tuning.regular
            and least < ratio < most
        )

    def _own(self, seen: Sighting) -> bool:
        """Whether the wall certainly makes this motion.

        Args:
            seen: The motion now.
        """
        before = self._probe.before
        explained = explains(seen.inertia, before.inertia, self._probing)
        if self._cause == Cause.LONGER:
            tuning = self._tuning
            ratios = tuning.own_first, tuning.own_second, tuning.own_third
            longer = seen.cycle / before.cycle > ratios[min(self._step, 3) - 1]
            return explained and longer and self._lasting.streak > 0
        if self._cause == Cause.BEYOND_HANDS:
            return explained or self.steady or self._beyond_hands(seen)
        return self.steady

    def _is_last(self) -> bool:
        """Whether no further reduction is possible, or no time is left."""
        return self._softest or (not self._settings.bounces and self._late())

    def _late(self) -> bool:
        """Whether the time within which the motion must decay is nearly over."""
        tuning = self._tuning
        allowed = min(tuning.cycles * self._slowest, tuning.longest_s)
        return self._time - self._begun > tuning.hurry * allowed

    @property
    def _slowest(self) -> float:
        """Return the period of the slowest motion at K [s]."""
        stiffness = self._stiffness
        return math.tau * math.sqrt(self._settings.heaviest / stiffness) if stiffness > 0 else 1e9

    def _died(self) -> None:
        """Process the rest of the reduced wall; the next motion has its own time and evidence."""
        self.alarm = False
        self._begun = self._time
        self._count = 0

    def _was_wrong(self) -> None:
        """Undo the alarm."""
        self.alarm = self.small_cycle = self.backlash = False
        self.returned += 1
        self._somebody_moves_it()

    def _somebody_moves_it(self) -> None:
        """Restore the gains, and ignore this motion for a while."""
        self.moved += 1
        self.suspected = False
        self._hand.found(self._probe.before, self._time)
        self.phase = Phase.RETURNING
