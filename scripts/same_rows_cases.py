"""The runs whose rows must stay the same: name, preset, seconds, and what is set.

Each run is on the simulated clock and takes 1 to 3 s of it. Together they pass through every side
of the wall, both schedules, every mode of the guard, every answer to an oscillation, every fault of
the emulated bus, and the trips that a simulated run can have.
"""

from __future__ import annotations

from typing import NamedTuple


class Case(NamedTuple):
    """One run of the command."""

    preset: str
    seconds: float
    sets: tuple[str, ...]
    """Values for ``--set``"""


def _simulated(seconds: float, *sets: str) -> Case:
    return Case("simulated", seconds, sets)


def _emulated(seconds: float, *sets: str) -> Case:
    return Case("emulated-ideal", seconds, sets)


_LINEAR: tuple[str, ...] = (
    "servo.coulomb=0",
    "servo.hand=none",
    "wall.side=both",
    "servo.counts_per_rev=0",
)
_LINEAR += ("servo.torque_step=0", "servo.torque_limit=100")
"""A servo without friction, encoder steps and saturation in a two-sided wall"""
_DECEIVED: tuple[str, ...] = (
    "wall.side=both",
    "servo.hand=none",
    "servo.coulomb=0.01",
    "servo.kick=0.02",
)
_DECEIVED += ("servo.delay=0.006", "model.delay=0.002", "wall.stiffness=30")
"""The servo's lag is longer than the guard believes: the wall oscillates"""
_DEAF = ("safety.max_silence_s=0.015", "safety.max_loss=0.05", "servo.watchdog_s=0.04")
"""The limits of hardware on lost readings"""
_TAP = "servo.hand=tap"
_LEAN = "servo.hand=lean"
_LINK: tuple[str, ...] = ("servo.load_inertia=0.003", "servo.transmission_stiffness=200")
_LINK += ("servo.transmission_damping=0.03", "wall.stiffness=1e6")
_LOSSY = ("safety.max_loss=1", "safety.max_silence_s=0.1")

CASES: dict[str, Case] = {
    # The wall and the operator model.
    "push": _simulated(3.0),
    "tap": _simulated(2.0, _TAP),
    "lean": _simulated(1.7, _LEAN),
    "below-tap": _simulated(2.0, _TAP, "wall.side=below"),
    "below-push": _simulated(2.5, "wall.side=below", "wall.damping=-0.003"),
    "both-kick": _simulated(1.0, "wall.side=both", "servo.hand=none", "servo.kick=0.05"),
    "both-lean": _simulated(1.7, "wall.side=both", _LEAN, "wall.damping=0.1"),
    "wall-elsewhere": _simulated(2.0, _TAP, "wall.position=12.3"),
    "reference-start": _simulated(1.7, _LEAN, "wall.reference=start", "wall.position=0.1"),
    "no-stiffness": _simulated(1.7, _LEAN, "wall.stiffness=0", "wall.damping=0.3"),
    "torque-clip": _simulated(1.7, _LEAN, "wall.torque_clip=0.2", "wall.stiffness=20"),
    "torque-limit": _simulated(2.0, _TAP, "servo.torque_limit=0.3", "wall.damping=0"),
    "slow-loop": _simulated(2.0, _TAP, "loop.rate_hz=200"),
    "quick-loop": _simulated(1.7, _LEAN, "loop.rate_hz=3000"),
    "odd-loop": _simulated(2.0, _TAP, "loop.rate_hz=777", "servo.delay=0.0004"),
    # Velocity, delay, encoder, passivity control.
    "velocity-4": _simulated(2.0, _TAP, "wall.velocity_samples=4", "wall.damping=0.1"),
    "velocity-16": _simulated(1.7, _LEAN, "wall.velocity_samples=16", "wall.damping=0.05"),
    "delay-1": _simulated(2.0, _TAP, "delay.steps=1"),
    "delay-7": _simulated(1.7, _LEAN, "delay.steps=7", "wall.stiffness=1e6"),
    "delay-100": _simulated(1.7, _LEAN, "delay.steps=100", "guard.mode=off"),
    "fine-encoder": _simulated(2.0, _TAP, "servo.counts_per_rev=262144"),
    "coarse-encoder": _simulated(2.0, _TAP, "servo.counts_per_rev=360", "wall.stiffness=1e6"),
    "no-encoder": _simulated(2.0, _TAP, "servo.counts_per_rev=0", "servo.torque_step=0"),
    "backlash": _simulated(2.0, _TAP, "servo.backlash=0.02", "wall.stiffness=1e6"),
    "passivity-control": _simulated(2.0, _TAP, "wall.passivity_control=true"),
    "passivity-control-delayed": _simulated(
        2.0, _TAP, "wall.passivity_control=true", "delay.steps=5", "guard.mode=off"
    ),
    # The guard.
    "guard-stable": _simulated(2.0, _TAP, "wall.stiffness=1e9", "wall.damping=0.03"),
    "guard-two-sided": _simulated(1.0, *_LINEAR, "wall.stiffness=1e9", "servo.kick=0.01"),
    "guard-passive": _simulated(2.0, _TAP, "guard.mode=passive", "wall.stiffness=1e6"),
    "guard-off": _simulated(1.0, *_LINEAR, "guard.mode=off", "servo.kick=0.01"),
    "guard-damping": _simulated(
        2.0, _TAP, "wall.damping=1e6", "wall.stiffness=1e6", "servo.counts_per_rev=0"
    ),
    "guard-negative-damping": _simulated(1.7, _LEAN, "wall.damping=-5", "wall.stiffness=100"),
    "guard-margin": _simulated(
        2.0, _TAP, "wall.stiffness=1e6", "guard.margin=0.3", "guard.damping_cap=0.2"
    ),
    "guard-quantisation": _simulated(
        1.7, _LEAN, "wall.stiffness=1e6", "wall.damping=0.02", "guard.quantisation_share=0.02"
    ),
    "guard-bounds": _simulated(
        2.0,
        _TAP,
        "wall.stiffness=1e6",
        "model.inertia={value: 0.012, low: 0.008, high: 0.02}",
        "model.damping={value: 0.011, low: 0.002, high: 0.02}",
        "model.delay={value: 0.001, low: 0, high: 0.002}",
        "model.torque_gain={value: 1, low: 0.8, high: 1.3}",
    ),
    "guard-sample-age": _simulated(2.0, _TAP, "wall.stiffness=1e6", "guard.sample_age=0.003"),
    # Oscillations.
    "oscillation-reduce": _simulated(2.0, *_DECEIVED),
    "oscillation-trip": _simulated(2.0, *_DECEIVED, "safety.on_oscillation=trip"),
    "oscillation-report": _simulated(1.5, *_DECEIVED, "safety.on_oscillation=report"),
    "oscillation-guard-off": _simulated(2.0, *_DECEIVED, "guard.mode=off"),
    "oscillation-passivity-control": _simulated(
        1.5, *_DECEIVED, "wall.passivity_control=true", "safety.on_oscillation=report"
    ),
    "oscillation-one-sided": _simulated(
        2.0, "servo.delay=0.008", "model.delay=0", "wall.stiffness=60", _LEAN
    ),
    "oscillation-linear": _simulated(
        1.5, *_LINEAR, "guard.mode=off", "wall.stiffness=70", "servo.kick=0.001"
    ),
    # The presets of the paper.
    "paper": Case("paper-table2", 1.5, ("guard.mode=off", "wall.stiffness=380")),
    "paper-delayed": Case("paper-table2", 1.0, ("delay.steps=3",)),
    "light-weight-robot": Case("lwr3", 1.0, ("delay.steps=1",)),
    # When the wall comes on, and what ends a run.
    "engage-wait": _simulated(3.0, _TAP, "servo.kick=1.6", "wall.stiffness=2"),
    "engage-at-once": _simulated(1.0, "servo.kick=0.4", "safety.engage=at-once"),
    "engage-torque": _simulated(
        2.5, _TAP, "servo.kick=1.6", "safety.engage_torque=0.5", "wall.stiffness=3"
    ),
    "trip-overspeed": _simulated(2.0, "safety.max_speed=2", _TAP),
    "trip-travel": _simulated(1.7, _LEAN, "safety.travel=[-0.2, 0.05]"),
    # The bus: schedules, adapters and faults.
    "bus": _emulated(2.0),
    "bus-pipelined": _emulated(1.5, "servo.schedule=pipelined", _LEAN),
    "bus-slow-baud": _emulated(1.5, "servo.baud=1000000", _LEAN, "wall.stiffness=1e6"),
    "bus-guard": _emulated(1.5, _TAP, "wall.stiffness=1e6", "wall.damping=0.05", "servo.id=7"),
    "bus-below": _emulated(1.5, _TAP, "wall.side=below", "servo.torque_limit=1"),
    "bus-both-oscillation": _emulated(
        1.5,
        "wall.side=both",
        "servo.delay=0.01",
        "model.delay=0",
        "wall.stiffness=40",
        "servo.kick=0.1",
    ),
    "bus-torque-constant": _emulated(
        1.5, _LEAN, "servo.torque_constant=2.2", "model.torque_gain={value: 1, low: 0.7, high: 1.3}"
    ),
    "bus-no-probe": _emulated(1.5, _TAP, "servo.probe_torque=0", "loop.warm_up_s=0.1"),
    "fault-drop": _emulated(1.5, *_LOSSY, "servo.faults=drop:p=0.03", _LEAN),
    "fault-corrupt": _emulated(
        1.5, *_LOSSY, "servo.faults=corrupt:p=0.05,way=reply", "servo.fault_seed=3", _LEAN
    ),
    "fault-truncate": _emulated(1.5, *_LOSSY, "servo.faults=truncate:p=0.03", _TAP),
    "fault-late": _emulated(1.5, *_LOSSY, "servo.faults=late:ms=1.5,p=0.1", _LEAN),
    "fault-late-pipelined": _emulated(
        1.5, *_LOSSY, "servo.faults=late:ms=1.5,p=0.1", "servo.schedule=pipelined", _LEAN
    ),
    "fault-duplicate-noise": _emulated(
        1.5, *_LOSSY, "servo.faults=duplicate:p=0.05 noise:p=0.05,bytes=9", _TAP
    ),
    "fault-wrong-id": _emulated(1.5, *_LOSSY, "servo.faults=wrong-id:p=0.05", _LEAN),
    "fault-stuck": _emulated(1.5, "servo.faults=stuck:at=1.3,for=0.2", _LEAN),
    "fault-jump": _emulated(1.5, "servo.faults=jump:counts=700,at=1.6", _LEAN),
    "fault-supply": _emulated(1.5, "servo.faults=supply:volts=8,at=1.6", _LEAN),
    "fault-ambient": _emulated(1.5, "servo.faults=ambient:celsius=95,at=1.6", _LEAN),
    "trip-silence": _emulated(1.5, *_DEAF, "servo.faults=drop:at=1.6,way=reply", _LEAN),
    "trip-loss-rate": _emulated(1.5, *_DEAF, "servo.faults=drop:p=0.15,at=1.2", _LEAN),
    "trip-hardware-error": _emulated(
        1.5, "servo.faults=hardware-error:bits=overload,at=1.6", _LEAN
    ),
    "fault-brown-out": _emulated(1.5, "servo.faults=brown-out:at=1.6", _LEAN),
    "trip-servo-lost": _emulated(1.5, "servo.faults=unplug-adapter:at=1.6", _LEAN),
    "unplugged-for-a-while": _emulated(1.5, "servo.faults=unplug:at=1.6,for=0.02", _LEAN),
    "refused-supply": _emulated(1.0, "servo.faults=supply:volts=9"),
    # What a real servo has besides.
    "static-friction": _simulated(
        2.0, _TAP, "servo.static_friction=0.2", "servo.stribeck_speed=1.1"
    ),
    "friction-each-way": _simulated(
        2.0, _TAP, "servo.damping_back=0.03", "servo.load_friction=0.12"
    ),
    "load-and-stribeck": _simulated(
        1.7,
        _TAP,
        "servo.static_friction=0.1",
        "servo.stribeck_speed=1.5",
        "servo.load_friction=0.3",
    ),
    "weight-and-cogging": _simulated(
        1.7, _LEAN, "servo.gravity=0.2", "servo.gravity_angle=-0.5", "servo.cogging=0.03"
    ),
    "encoder-errors": _simulated(
        2.0, _TAP, "servo.encoder_eccentricity=0.01", "servo.encoder_noise=0.4"
    ),
    "current-loop": _simulated(
        2.0, _TAP, "servo.current_bandwidth=160", "servo.current_period=0.0002"
    ),
    "back-emf": _simulated(
        2.0, _TAP, "servo.back_emf=true", "servo.current_droop=0.1", "servo.dead_band=0.1"
    ),
    "backlash-believed": _simulated(
        2.0, _TAP, "servo.backlash=0.005", "model.backlash=0.005", "wall.stiffness=1e6"
    ),
    "link": _simulated(2.0, _TAP, *_LINK),
    "link-backlash": _simulated(2.0, _TAP, *_LINK, "servo.backlash=0.004", "servo.encoder=motor"),
    "link-effects": _simulated(
        1.7, _LEAN, *_LINK, "servo.static_friction=0.12", "servo.gravity=0.1", "servo.cogging=0.02"
    ),
    "bus-real": Case("emulated-xm430", 1.5, (_TAP,)),
    "bus-real-guard": Case("emulated-xm430", 1.5, (_LEAN, "wall.stiffness=1e6", "wall.side=below")),
}
"""By name; a name stays with its run."""
