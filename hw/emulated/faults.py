"""Parses the faults for injection into the bus: ``NAME[:KEY=VALUE[,KEY=VALUE ...]]``.

There are two kinds. *Frame* faults hit single frames in either direction: each with a probability
``p``, every n-th with ``every``, or all. *Servo* faults occur to a servo or the adapter at an
instant. Times are seconds since the injection.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any, Final, NamedTuple

from haptic_wall.hw.dynamixel.codec import BROADCAST, MAX_ID
from haptic_wall.hw.errors import SpecError
from haptic_wall.hw.names import did_you_mean


def _number(low: float, high: float, kind: type = float) -> Callable[[str], Any]:
    """Return a reader of numbers in a range; its docstring names the range."""

    def parse(text: str) -> Any:  # noqa: ANN401 - of ``kind``
        value = float(text)
        if not low <= value <= high or kind(value) != value:
            raise ValueError
        return kind(value)

    parse.__doc__ = f"a {'whole ' * (kind is int)}number from {low:.10g} up to {high:.10g}"
    return parse


def suggestion(found: str, known: Iterable[str], prefix: str = "") -> str:
    """Return advice on an unknown name: the nearest known one, or all."""
    names = list(known)
    return did_you_mean(found, names, prefix) or f"known are {', '.join(names)}"


ERROR_BITS: Final[Mapping[str, int]] = MappingProxyType(
    {"voltage": 0x01, "overheating": 0x04, "encoder": 0x08, "shock": 0x10, "overload": 0x20}
)
"""Bits of Hardware Error Status by name"""
_SECOND_NS = 1_000_000_000


def _error_bits(text: str) -> int:
    bits = 0
    for name in text.split("+"):
        bits |= ERROR_BITS[name]
    return bits


_error_bits.__doc__ = "one or more, joined by +, of " + ", ".join(ERROR_BITS)


def _way(text: str) -> str:
    """one of request, reply, both"""  # noqa: D403, D415 - for the message
    return {way: way for way in ("request", "reply", "both")}[text]


class _Key(NamedTuple):
    parse: Callable[[str], Any]
    meaning: str


class _Kind(NamedTuple):
    example: str
    keys: tuple[str, ...] = ()
    """In addition to those of every fault of its kind"""
    required: tuple[str, ...] = ()
    strikes_frames: bool = False


KEYS: Final[Mapping[str, _Key]] = MappingProxyType(
    {
        "p": _Key(_number(0, 1), "probability for each frame"),
        "every": _Key(_number(1, 10**9, int), "every n-th frame"),
        "times": _Key(_number(1, 10**9, int), "largest number of times"),
        "at": _Key(_number(0, 1e6), "start [s]"),
        "for": _Key(_number(1e-6, 1e6), "duration [s]"),
        "repeat": _Key(_number(0.001, 1e6), "time until the next one [s]"),
        "way": _Key(_way, "frames to the servos, from them, or both"),
        "id": _Key(_number(0, BROADCAST, int), "frames with this id, or the servo"),
        "flips": _Key(_number(1, 64, int), "bits that are flipped"),
        "keep": _Key(_number(0, 2055, int), "bytes that arrive"),
        "ms": _Key(_number(0.001, 10_000), "delay [ms]"),
        "to": _Key(_number(0, MAX_ID, int), "the wrong id"),
        "bytes": _Key(_number(1, 255, int), "bytes of garbage"),
        "counts": _Key(_number(-(2**24), 2**24, int), "encoder counts, signed"),
        "bits": _Key(_error_bits, "hardware errors"),
        "volts": _Key(_number(0.1, 60), "voltage of the supply [V]"),
        "celsius": _Key(_number(-40, 200), "temperature around the servo [°C]"),
    }
)
KINDS: Final[Mapping[str, _Kind]] = MappingProxyType(
    {
        "drop": _Kind("drop:p=0.01", strikes_frames=True),
        "corrupt": _Kind("corrupt:p=0.01", ("flips",), strikes_frames=True),
        "truncate": _Kind("truncate:p=0.01", ("keep",), strikes_frames=True),
        "duplicate": _Kind("duplicate:p=0.01", strikes_frames=True),
        "late": _Kind("late:ms=3,p=0.01", ("ms",), ("ms",), strikes_frames=True),
        "wrong-id": _Kind("wrong-id:p=0.01", ("to",), strikes_frames=True),
        "noise": _Kind("noise:p=0.01", ("bytes",), strikes_frames=True),
        "stuck": _Kind("stuck:at=2,for=0.5", ("for", "id")),
        "jump": _Kind("jump:counts=500,at=2", ("counts", "for", "id"), ("counts",)),
        "hardware-error": _Kind("hardware-error:bits=overload,at=3", ("bits", "id"), ("bits",)),
        "supply": _Kind("supply:volts=9,at=2,for=0.5", ("volts", "for", "id"), ("volts",)),
        "ambient": _Kind("ambient:celsius=60,at=2", ("celsius", "for", "id"), ("celsius",)),
        "brown-out": _Kind("brown-out:at=2", ("id",)),
        "unplug": _Kind("unplug:at=2,for=0.5", ("for", "id")),
        "unplug-adapter": _Kind("unplug-adapter:at=2,for=0.5", ("for",)),
    }
)
"""The faults; docs/how-to/emulated-bus.md says what each does"""
_FRAME_KEYS = ("p", "every", "times", "at", "for", "way", "id")
_SERVO_KEYS = ("at", "repeat", "times")


@dataclass(frozen=True, slots=True)
class Fault:
    """One requested fault."""

    text: str
    name: str
    values: Mapping[str, Any]
    """By key, as given"""

    @property
    def strikes_frames(self) -> bool:
        """Whether it hits frames; else it occurs to a servo or to the adapter."""
        return KINDS[self.name].strikes_frames

    def time_ns(self, key: str) -> int | None:
        """Return the time of this key [ns], such as ``for``; None: it is not given."""
        seconds = self.values.get(key)
        return None if seconds is None else round(seconds * _SECOND_NS)

    def check_servo(self, ids: Collection[int]) -> None:
        """Check that its servo, if it names one, is among those with these ids.

        Raises:
            ValueError: It is not.
        """
        id_ = self.values.get("id")
        if not self.strikes_frames and id_ is not None and id_ not in ids:
            raise SpecError(
                f"no servo on this bus has the id {id_}",
                given=self.text,
                advice=f"the ids here are {', '.join(map(str, ids))}",
            )


def parse_fault(text: str) -> Fault:
    """Return the fault that ``text`` describes.

    Raises:
        ValueError: It is none; the message says what was found and what is wanted.
    """
    name, colon, rest = text.strip().partition(":")
    kind = KINDS.get(name)
    if kind is None:
        raise SpecError(f"no fault is called {name!r}", advice=suggestion(name, KINDS))
    known = kind.keys + (_FRAME_KEYS if kind.strikes_frames else _SERVO_KEYS)
    values: dict[str, Any] = {}
    for part in rest.split(",") if colon else ():
        key, equals, value = (piece.strip() for piece in part.partition("="))
        if key not in known:
            raise SpecError(
                f"{name} has no {key!r}; {suggestion(key, known)}",
                advice=f"e.g. {kind.example}",
            )
        if not equals or key in values:
            wrong = "is given twice" if key in values else "has no value"
            raise SpecError(
                f"{key} {wrong}", given=name, advice=f"give it once, as in {kind.example}"
            )
        try:
            values[key] = KEYS[key].parse(value)
        except (ValueError, KeyError):
            wanted = KEYS[key].parse.__doc__
            raise SpecError(f"found {value!r}", given=f"{name}: {key}", wanted=wanted) from None
    for key in kind.required:
        if key not in values:
            raise SpecError(f"wanted {key} ({KEYS[key].meaning}), e.g. {kind.example}", given=name)
    _check_together(name, values)
    return Fault(text.strip(), name, MappingProxyType(values))


def _check_together(name: str, values: Mapping[str, Any]) -> None:
    if "p" in values and "every" in values:
        raise SpecError("found both p and every, wanted one", given=name, advice="leave one out")
    lasts, repeat = values.get("for"), values.get("repeat")
    if "times" in values and repeat is None and not KINDS[name].strikes_frames:
        raise SpecError("found times without repeat", given=name, advice="add repeat=S")
    if lasts is not None and repeat is not None and repeat <= lasts:
        raise SpecError(
            f"the next one begins (repeat={repeat:g}) before this one ends (for={lasts:g})",
            given=name,
            advice="give a longer repeat",
        )
