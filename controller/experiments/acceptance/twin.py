"""Makes the emulated servo of an acceptance: its true parameters are the believed ones."""

from __future__ import annotations

from haptic_wall.controller.experiments.holding import torque_limit_of
from haptic_wall.controller.settings.config import Config

_TRUTH = ("inertia", "damping", "coulomb", "delay", "backlash")


def twin_of(config: Config) -> Config:
    """Return an emulated servo with the middle of the belief as its truth, on the simulated clock.

    The belief, the loop and the driver are CONFIG's. A servo without a bus has a twin without one.

    Args:
        config: The effective configuration.
    """
    belief, gain = config.belief(), config.belief().torque_gain.value
    raw = config.model_dump(mode="json")
    servo = raw["servo"]
    bus = config.servo.kind != "simulated"
    kept = ("backend", "baud", "id", "model", "schedule", "probe_torque", "watchdog_s")
    truth = {name: getattr(belief, name).value for name in _TRUTH}
    for name in ("inertia", "damping", "coulomb"):
        truth[name] /= gain  # a torque gain above 1 moves a servo as if it were lighter
    raw["servo"] = {
        **{name: servo[name] for name in kept if servo.get(name) is not None},
        **truth,
        "torque_limit": torque_limit_of(config),
        "hand": "none",
    }
    if bus:
        raw["servo"]["port"] = "emulated"
    else:
        raw["servo"]["counts_per_rev"] = config.servo.counts_per_rev
    raw["model"] = {
        name: {"value": each.value, "low": each.low, "high": each.high}
        for name in (*_TRUTH, "torque_gain")
        if (each := getattr(belief, name)) is not None
    }
    raw["loop"]["clock"] = "simulated"
    raw["realtime"] = {"profile": "off"}
    return Config.model_validate(raw)
