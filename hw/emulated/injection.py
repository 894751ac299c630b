"""Decides when each injected fault acts, from a seed and nothing else, and applies it.

Every fault has a random stream of its own, so that one more fault does not change the others.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Sequence
from dataclasses import dataclass, field
from random import Random
from typing import NamedTuple

from haptic_wall.hw.dynamixel.codec import BROADCAST, MAX_ID, crc16
from haptic_wall.hw.emulated.faults import Fault, parse_fault
from haptic_wall.hw.emulated.rules import AMBIENT
from haptic_wall.hw.emulated.servo import EmulatedServo
from haptic_wall.hw.emulated.traffic import ID_AT, Part, id_of

_ID_OF_PART, _SHORTEST = 1, 10
_NOISE = 8
"""Default number of garbage bytes"""


@dataclass(slots=True)
class Passage:
    """A frame, or a servo's part of a joint reply, after the faults."""

    chunks: list[bytes]
    """The received bytes: noise, the frame, a copy; empty where it is lost"""
    id_at: int = ID_AT
    """Offset of its id"""
    crc: int = 0
    """Checksum of the bytes before it"""
    gaps: list[tuple[int, int]] = field(default_factory=list)
    """Offsets of the received bytes before which there is a pause, and its length [ns]"""
    names: list[tuple[int | None, str]] = field(default_factory=list)
    """The faults that hit it, each with the id of the frame or part"""


def strike(fault: Fault, passage: Passage, rng: Random) -> None:
    """Apply ``fault`` to the frame in ``passage``."""
    values = fault.values
    chunks = passage.chunks
    if fault.name == "late":
        passage.gaps.append((0, round(values["ms"] * 1_000_000)))
    elif fault.name == "noise":
        noise = rng.randbytes(values.get("bytes", _NOISE))
        chunks.insert(0, noise)
        passage.gaps = [(at + len(noise) if at else 0, late_ns) for at, late_ns in passage.gaps]
    elif fault.name == "duplicate":
        chunks.append(chunks[-1])
    elif fault.name == "drop":
        chunks.clear()
    elif fault.name == "corrupt":
        chunks[-1] = _flip(chunks[-1], fault, rng)
    elif fault.name == "truncate":
        chunks[-1] = _truncate(chunks[-1], fault, rng)
    else:
        chunks[-1] = _readdress(chunks[-1], passage, fault, rng)


def _flip(wire: bytes, fault: Fault, rng: Random) -> bytes:
    """Flip distinct bits, each with equal probability."""
    damaged = bytearray(wire)
    count = min(fault.values.get("flips", 1), 8 * len(wire))
    for bit in rng.sample(range(8 * len(wire)), count):
        damaged[bit // 8] ^= 1 << bit % 8
    return bytes(damaged)


def _truncate(wire: bytes, fault: Fault, rng: Random) -> bytes:
    """Keep the first bytes: the given number, else from one to all but one."""
    keep = fault.values.get("keep")
    return wire[: rng.randint(1, max(1, len(wire) - 1)) if keep is None else keep]


def _readdress(wire: bytes, passage: Passage, fault: Fault, rng: Random) -> bytes:
    """Replace the id and adapt the CRC; bytes that are no whole frame stay."""
    at = passage.id_at
    if at == ID_AT and (id_of(wire) is None or len(wire) < _SHORTEST):
        return wire
    other = fault.values.get("to")
    if other is None:
        other = rng.choice([id_ for id_ in range(MAX_ID + 1) if id_ != wire[at]])
    return _sealed(wire[:at] + bytes([other]) + wire[at + 1 : -2], passage.crc)


def _sealed(data: bytes, crc: int) -> bytes:
    """Append the checksum of ``data`` and the bytes before it, whose checksum is ``crc``."""
    return data + crc16(data, crc).to_bytes(2, "little")


_DEAFENING = ("drop", "corrupt", "truncate", "wrong-id")
"""Faults of one id that keep a joint instruction from its servo"""
_HELD = ("stuck", "supply", "ambient", "unplug", "unplug-adapter")
"""Faults with a duration; a jump only if one is given"""


class FaultEvent(NamedTuple):
    """The beginning or end of a fault of a servo or of the adapter."""

    fault: Fault
    begins: bool
    """It begins; else it ends"""


class _Acting:
    """An injected fault and its state."""

    def __init__(self, fault: Fault, now_ns: int, rng: Random) -> None:
        self.fault = fault
        self.rng = rng
        self.begin_ns = now_ns + (fault.time_ns("at") or 0)
        lasts_ns = fault.time_ns("for")
        self.end_ns = None if lasts_ns is None else self.begin_ns + lasts_ns
        self.done = 0
        """How often it has occurred"""
        self.begun = False
        """It acts on a servo or the adapter now"""
        self.due: list[tuple[int, bool]] = []
        """Its next events on a servo or the adapter: time [ns], and whether it begins"""
        self._seen = 0

    def strikes(self, id_: int | None, way: str, now_ns: int) -> bool:
        """Whether it hits this frame."""
        values = self.fault.values
        if now_ns < self.begin_ns or (self.end_ns is not None and now_ns >= self.end_ns):
            return False
        if values.get("way", "both") not in (way, "both") or values.get("id", id_) != id_:
            return False
        if self.spent:
            return False
        self._seen += 1
        every, probability = values.get("every"), float(values.get("p", 1.0))
        if every is None:
            return self.rng.random() < probability
        return self._seen % int(every) == 0

    @property
    def spent(self) -> bool:
        """Whether it has occurred as often as requested."""
        times = self.fault.values.get("times")
        return times is not None and self.done >= int(times)


class Faults:
    """The faults on one bus.

    Args:
        specs: Faults from the beginning, see ``parse_fault``.
        seed: Seed of every random choice.

    Raises:
        ValueError: One of them is no fault.
    """

    def __init__(self, specs: Iterable[str] = (), seed: int = 0) -> None:
        self._seed = seed
        self._number = 0
        self._frames: list[_Acting] = []
        self._servos: list[_Acting] = []
        self.at_start = [parse_fault(spec) for spec in specs]
        """Faults that the bus adds when it starts"""

    def add(self, fault: Fault, now_ns: int) -> None:
        """Inject ``fault``; its times count from ``now_ns`` [ns]."""
        rng = Random(f"{self._seed} {self._number} {fault.text}")
        self._number += 1
        acting = _Acting(fault, now_ns, rng)
        if fault.strikes_frames:
            self._frames.append(acting)
        else:
            self._servos.append(acting)
            acting.due.append((acting.begin_ns, True))

    def lift(self, name: str) -> list[FaultEvent] | None:
        """End all faults of this name; return the resulting events. None: there was none."""
        found = [acting for acting in self._all() if acting.fault.name == name]
        over = [FaultEvent(acting.fault, False) for acting in found if acting.begun]
        self._frames = [acting for acting in self._frames if acting not in found]
        self._servos = [acting for acting in self._servos if acting not in found]
        return over if found else None

    @property
    def strikes_frames(self) -> bool:
        """Whether any active fault can hit frames."""
        return bool(self._frames)

    def describe(self) -> list[tuple[str, int]]:
        """Return the active faults, and how often each has occurred."""
        return [(acting.fault.text, acting.done) for acting in self._all()]

    def pass_frame(self, parts: Sequence[Part], way: str, now_ns: int) -> Passage:
        """Pass a frame through the faults.

        Args:
            parts: The frame; of a joint reply its beginning, with the id for all, and then the part
                of each servo.
            way: ``request`` or ``reply``.
            now_ns: The time [ns].
        """
        id_, wire = parts[0]
        passage = Passage([wire]) if len(parts) == 1 else self._pass_parts(parts, now_ns)
        struck = [acting for acting in self._frames if acting.strikes(id_, way, now_ns)]
        self._strike(struck, passage, id_)
        return passage

    def deaf(self, ids: Collection[int], now_ns: int) -> list[tuple[int, str]]:
        """Return which of the servos with these ids do not hear a joint instruction, and why."""
        found = []
        for acting in self._frames:
            id_: int = acting.fault.values.get("id", BROADCAST)
            name = acting.fault.name
            if id_ in ids and name in _DEAFENING and acting.strikes(id_, "request", now_ns):
                acting.done += 1
                found.append((id_, name))
        return found

    def _pass_parts(self, parts: Sequence[Part], now_ns: int) -> Passage:
        """Pass a joint reply through the faults of single ids.

        Each servo waits for the end of the part before it, and appends the checksum over all that
        it has heard.
        """
        heard = parts[0].wire
        gaps: list[tuple[int, int]] = []
        names: list[tuple[int | None, str]] = []
        for id_, wire in parts[1:]:
            crc = crc16(heard)
            part = Passage([_sealed(wire[:-2], crc)], id_at=_ID_OF_PART, crc=crc)
            own = [acting for acting in self._frames if acting.fault.values.get("id") == id_]
            struck = [acting for acting in own if acting.strikes(id_, "reply", now_ns)]
            self._strike(struck, part, id_)
            gaps += [(len(heard) + at, late_ns) for at, late_ns in part.gaps]
            names += part.names
            heard += b"".join(part.chunks)
            if any(acting.fault.name in ("drop", "truncate") for acting in struck):
                break
        return Passage([heard], gaps=gaps, names=names)

    def _strike(self, struck: Sequence[_Acting], passage: Passage, id_: int | None) -> None:
        lost = [acting for acting in struck if acting.fault.name == "drop"]
        for acting in lost[:1] or struck:
            acting.done += 1
            passage.names.append((id_, acting.fault.name))
            strike(acting.fault, passage, acting.rng)

    def next_ns(self) -> int | None:
        """Return the time of the next event of a servo or the adapter [ns]; None: none."""
        return min((acting.due[0][0] for acting in self._servos if acting.due), default=None)

    def take_event(self, now_ns: int) -> FaultEvent:
        """Return the next event due at ``now_ns`` [ns], and plan the one after it."""
        acting = min((each for each in self._servos if each.due), key=lambda each: each.due[0][0])
        (_, begins), fault = acting.due.pop(0), acting.fault
        lasts_ns, repeat_ns = fault.time_ns("for"), fault.time_ns("repeat")
        held = fault.name in _HELD or (fault.name == "jump" and lasts_ns is not None)
        acting.begun = begins and held
        if begins:
            acting.done += 1
            if lasts_ns is not None:
                acting.due.append((now_ns + lasts_ns, False))
            if repeat_ns is not None and not acting.spent:  # after its end
                acting.due.append((now_ns + repeat_ns, True))
        return FaultEvent(fault, begins)

    def _all(self) -> list[_Acting]:
        return self._frames + self._servos


SILENCING = ("brown-out", "unplug")
"""Faults that truncate a reply on its way"""


def apply_fault(event: FaultEvent, servo: EmulatedServo, now_ns: int) -> None:
    """Begin or end the fault on ``servo`` at ``now_ns`` [ns]."""
    fault, begins = event
    servo.keep_up(now_ns)
    match fault.name:
        case "stuck" if begins:
            servo.mechanism.advance(now_ns)
            servo.drive.stuck_at = servo.drive.counts()
        case "stuck":
            servo.drive.stuck_at = None
        case "jump":
            counts: int = fault.values["counts"]
            servo.drive.shifted += counts if begins else -counts
        case "hardware-error" if not servo.unplugged:
            servo.latch_errors(fault.values["bits"], now_ns)
        case "supply":
            servo.set_supply(fault.values["volts"] if begins else servo.model.voltage, now_ns)
        case "ambient":
            servo.set_ambient(fault.values["celsius"] if begins else AMBIENT, now_ns)
        case "unplug" if begins:
            servo.unplug(now_ns)
        case "unplug":
            servo.reboot(now_ns)
        case "brown-out" if not servo.unplugged:
            servo.reboot(now_ns)
