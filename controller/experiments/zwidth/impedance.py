"""Estimates the impedance that a wall rendered, over frequency, from a log.

The impedance is the torque against the motion over the displacement, ``D(w) = -torque / position``.
Its real part is the effective stiffness, its imaginary part over the angular frequency the
effective damping. It is estimated by Welch's method over the stretches in which one wall acted
without a break. Position and torque come from the same encoder counts, so they are coherent where
nothing moves, too: a frequency counts as excited where the motion is well above the noise of the
counts.

Source: Welch (1967) for the spectra; Bendat and Piersol, Random Data, ch. 9, for the standard error
of a gain from its coherence.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from haptic_wall.controller.errors import UserError
from haptic_wall.controller.logs.reader import LogReader
from haptic_wall.controller.logs.walls import walls_of
from haptic_wall.controller.runtime.telemetry import (
    FLAG_CONTACT,
    FLAG_OFF,
    FLAG_SATURATED,
    FLAG_WARM_UP,
)
from haptic_wall.controller.settings.config import Config
from haptic_wall.controller.theory.checks import ComplexArray, FloatArray
from haptic_wall.controller.theory.velocity_filter import VelocityFilter
from haptic_wall.hw.servo import Outcome

_SEGMENT_S = 2.0
"""Usual length of a segment [s]; shorter contacts are cut to what they hold"""
_LEAST_ROWS = 128
_LEAST_SEGMENTS = 4
_LEAST_BINS = 2
"""Least number of frequencies of the spectrum in a band"""
_COHERENT = 0.5
"""Least coherence at which a frequency has a figure"""
_ABOVE = 10.0
"""Least power of the motion over that of the encoder's counts"""
_FAINTEST = 1e-7
"""Motion that is none without an encoder [rad rms over all frequencies]"""
_BANDS_A_DECADE = 6
_UP_TO = 0.4
"""Highest band, over the rate"""


@dataclass(frozen=True, slots=True)
class Band:
    """The impedance in a band of frequencies; None: not excited."""

    frequency_hz: float
    commanded_stiffness: float
    """Effective stiffness of the law, inserted delay included [N·m/rad]"""
    commanded_damping: float
    """Effective damping of the law [N·m·s/rad]"""
    acting_stiffness: float
    """With the whole believed delay and the hold of the torque over a period [N·m/rad]"""
    acting_damping: float
    stiffness: float | None = None
    """Measured [N·m/rad]"""
    damping: float | None = None
    stderr: float | None = None
    """Standard error of the measured impedance's size [N·m/rad]"""
    coherence: float | None = None
    reason: str | None = None
    """``not excited``, or why there is no figure"""


@dataclass(frozen=True, slots=True)
class Impedance:
    """The impedance of a wall over frequency."""

    stiffness: float
    """Commanded [N·m/rad]"""
    virtual_damping: float
    delay_s: float
    torque: str
    """The torque that was compared: ``measured`` by the servo, or ``sent`` to it"""
    rows: int
    """Number of rows that were used"""
    segments: int
    bands: tuple[Band, ...]
    reason: str | None = None
    """Why nothing was measured; None: something was"""

    def because(self, reason: str) -> Impedance:
        """Return it with a reason why nothing was measured."""
        return replace(self, reason=reason)

    def report(self) -> dict[str, Any]:
        """Return JSON-ready values."""
        return asdict(self)


@dataclass(frozen=True, slots=True)
class Law:
    """The numbers of a wall's law that decide its impedance."""

    stiffness: float
    damping: float
    period: float
    samples: int
    velocity_filter: VelocityFilter | None

    @classmethod
    def of(cls, config: Config, stiffness: float, damping: float) -> Law:
        """Return the law of a configuration with the commanded gains."""
        wall = config.wall
        return cls(
            stiffness, damping, config.period_s, wall.velocity_samples, config.velocity_filter()
        )

    def response(self, frequency_hz: FloatArray, delay: float, held: bool) -> ComplexArray:
        """Return the impedance [N·m/rad], complex.

        Args:
            frequency_hz: Up to half the rate [Hz].
            delay: From a sample to its torque [s].
            held: The torque is held over a period.
        """
        w = math.tau * frequency_hz
        z = np.exp(-1j * w * self.period)
        velocity = (1.0 - z**self.samples) / (self.samples * self.period)
        if self.velocity_filter is not None:
            velocity = velocity * self.velocity_filter.response(w * self.period)
        answer = (self.stiffness + self.damping * velocity) * np.exp(-1j * w * delay)
        if held:
            answer = answer * np.sinc(frequency_hz * self.period) * np.sqrt(z)
        found: ComplexArray = answer
        return found


def bands_of(law: Law, inserted: float, delay: float) -> tuple[Band, ...]:
    """Return the commanded impedance in bands of a sixth of a decade.

    Args:
        law: The law.
        inserted: Inserted delay [s].
        delay: Whole believed delay [s].
    """
    highest = _UP_TO / law.period
    count = math.floor(_BANDS_A_DECADE * math.log10(highest)) + 1
    centres = 10.0 ** (np.arange(count) / _BANDS_A_DECADE)
    w = math.tau * centres
    commanded = law.response(centres, inserted, held=False)
    acting = law.response(centres, delay, held=True)
    return tuple(
        Band(*(float(each) for each in figures))  # type: ignore[arg-type]
        for figures in zip(
            centres, commanded.real, commanded.imag / w, acting.real, acting.imag / w, strict=True
        )
    )


def commanded(config: Config, stiffness: float, damping: float, delay: float) -> Impedance:
    """Return the impedance of a wall of which nothing was measured yet."""
    inserted = config.delay.steps * config.period_s
    bands = bands_of(Law.of(config, stiffness, damping), inserted, delay)
    return Impedance(stiffness, damping, delay, "sent", 0, 0, bands)


def from_log(log: LogReader) -> Impedance:
    """Measure the impedance from the log of a run.

    Args:
        log: Rows of a run of a wall.

    Raises:
        UserError: The log is not that of a wall, or it was changed while it ran.
        LogFormatError: Its configuration cannot be used.
    """
    walls = walls_of(log.metadata, log.changes)
    config = walls.configs[0]
    if len(walls.configs) > 1:
        raise UserError(
            "the wall was changed while it ran",
            field="--log",
            given=log.path,
            advice="record an unchanged wall",
        )
    if config.wall.law != "wall":
        raise UserError(
            f"found the law {config.wall.law}",
            field="--log",
            given=log.path,
            wanted="the log of a wall",
        )
    stretches, gains, delay = _stretches(log.rows())
    if not stretches:
        gains = (config.wall.stiffness, config.wall.damping)
    law = Law.of(config, *gains)
    bands = bands_of(law, config.delay.steps * law.period, delay)
    most = max((len(each) for each in stretches), default=0)
    size = min(round(_SEGMENT_S / law.period), most)
    empty = Impedance(*gains, delay, "sent", 0, 0, bands)
    if not stretches:
        return empty.because("the log has no row in which the wall acted")
    if size < _LEAST_ROWS:
        why = f"the longest contact without a break has {most} rows, {_LEAST_ROWS} are needed"
        return empty.because(why)
    measured = all(np.isfinite(each["measured_torque"]).all() for each in stretches)
    column = "measured_torque" if measured else "torque"
    found = _spectra(stretches, column, size)
    if found.segments < _LEAST_SEGMENTS:
        why = f"{found.segments} segments of {size} rows in contact, {_LEAST_SEGMENTS} are needed"
        return empty.because(why)
    answer = tuple(_measured(band, found, law.period, config.servo.position_step) for band in bands)
    excited = any(band.stiffness is not None for band in answer)
    return Impedance(
        *gains,
        delay,
        "measured" if measured else "sent",
        sum(map(len, stretches)),
        found.segments,
        answer,
        None if excited else "not excited: the shaft moved by less than the encoder's noise",
    )


def _stretches(
    rows: NDArray[Any],
) -> tuple[list[NDArray[np.void]], tuple[float, float], float]:
    """Return the longest-lasting wall's unbroken stretches of contact, its gains, and its delay."""
    if not len(rows):
        return [], (0.0, 0.0), 0.0
    on = (rows["flags"] & (FLAG_WARM_UP | FLAG_OFF | FLAG_SATURATED)) == 0
    on &= ((rows["flags"] & FLAG_CONTACT) > 0) & (rows["outcome"] == Outcome.OK)
    on &= (rows["held_torque"] == 0.0) & (rows["missed"] == 0) & (rows["stiffness"] > 0.0)
    if not on.any():
        return [], (0.0, 0.0), 0.0
    gains = np.stack([rows["stiffness"], rows["damping"]], axis=1)
    each, counts = np.unique(gains[on], axis=0, return_counts=True)
    wall = each[np.argmax(counts)]
    on &= (gains == wall).all(axis=1)
    delay = float(np.median(rows["delay_s"][on]))
    ends = np.flatnonzero(np.diff(np.concatenate([[False], on, [False]]).astype(np.int8)))
    found = [rows[a:b] for a, b in zip(ends[::2], ends[1::2], strict=True)]
    longest = max(map(len, found))
    return (
        [part for part in found if len(part) >= max(_LEAST_ROWS, 0.2 * longest)],
        (float(wall[0]), float(wall[1])),
        delay,
    )


@dataclass(frozen=True, slots=True)
class _Spectra:
    """Averaged over all segments; power densities over one side."""

    frequency: FloatArray
    """In cycles a sample"""
    motion: FloatArray
    """Of the position [rad² a cycle a sample]"""
    torque: FloatArray
    cross: ComplexArray
    segments: int


def _spectra(stretches: Sequence[NDArray[np.void]], column: str, size: int) -> _Spectra:
    """Return the spectra of overlapping halves, without their straight lines."""
    from scipy.signal import csd

    step = size // 2
    segments = 0
    sums = np.zeros((3, step + 1), dtype=np.complex128)
    for rows in stretches:
        count = max((len(rows) - size) // step + 1, 0)
        x, u = rows["position"], rows[column]
        for i, pair in enumerate(((x, x), (u, u), (x, u)) if count else ()):
            options = {"window": np.hanning(size), "noverlap": size - step, "detrend": "linear"}
            sums[i] += count * csd(*pair, **options)[1]
        segments += count
    motion, torque, cross = sums / max(segments, 1)
    return _Spectra(np.arange(step + 1) / size, motion.real, torque.real, cross, segments)


def _measured(band: Band, found: _Spectra, period: float, step: float) -> Band:
    """Return a band with its figures, or the reason why it has none."""
    centre = band.frequency_hz * period
    half = 10.0 ** (0.5 / _BANDS_A_DECADE)
    inside = (found.frequency >= centre / half) & (found.frequency < centre * half)
    inside[:2] = False  # what the straight line has taken
    if inside.sum() < _LEAST_BINS:
        return replace(band, reason="the contacts are too short for so low a frequency")
    motion, torque = float(found.motion[inside].sum()), float(found.torque[inside].sum())
    # Rounding to a count is white noise of step²/12 over all frequencies.
    noise = max(step**2 / 12.0, _FAINTEST**2) * 2.0 * float(inside.sum())
    if motion < _ABOVE * noise or torque <= 0.0:
        return replace(band, reason="not excited")
    cross = complex(found.cross[inside].sum())
    # The impedance turns within a band: its sum loses a little, which the law's loses too.
    coherence = min(abs(cross) ** 2 / (motion * torque), 1.0)
    if coherence < _COHERENT:
        return replace(band, reason=f"coherence {coherence:.2f}, at least {_COHERENT:g} is needed")
    gain = -cross / motion
    # The frequency at which the motion is, within the band.
    w = math.tau / period * float((found.frequency * found.motion)[inside].sum()) / motion
    error = abs(gain) * math.sqrt((1.0 - coherence) / (2.0 * coherence * found.segments))
    return replace(
        band,
        stiffness=gain.real,
        damping=gain.imag / w,
        stderr=error,
        coherence=coherence,
    )
