"""The keys of a run's report, with their meanings; the page of the reference is made from them."""

from collections.abc import Mapping
from typing import Final

REPORT_KEYS: Final[Mapping[str, str]] = {
    "ticks": "ticks executed while the wall was on",
    "missed_ticks": "whole periods skipped",
    "duration_s": "time the wall was on, by the grid [s]",
    "rate_hz": "ticks over duration [Hz]",
    "grid_hz": "rate of the grid [Hz]",
    "real_time_factor": "how many times faster than real time the simulated clock ran; else null",
    "stalled_s": "how long loop and emulated bus waited for this computer; null: they do not [s]",
    "lateness_us": "from the deadline to the wake-up [µs]",
    "work_us": "the controller's own time in a tick [µs]",
    "bus_us": "waiting for the reply [µs]",
    "bus": "null for the servo simulated in the loop's process",
    "bus.schedule": "`immediate` or `pipelined`, also where `auto` chose it",
    "bus.cycles": "requests, warm-up included",
    "bus.lost": "no reply in time, or one cut short",
    "bus.late": "replies after that time, never used",
    "bus.corrupt": "replies with a wrong checksum, or a refusal",
    "bus.refused": "valid replies with a position that the servo cannot have reached",
    "bus.sample_age_us": "age of the sample when its torque is sent [µs]",
    "delay_s": "the delay that the guard used [s]",
    "delay_s.inserted": "`delay.steps` periods; with missed ticks, up to the first one after them",
    "delay_s.device": "upper bound of the believed lag",
    "delay_s.measured": "the sample's age: a percentile, rounded up to a bin of the gain schedule",
    "delay_s.total": "their sum",
    "guard": "the decision in force at the end",
    "guard.requested.stiffness": "K [N·m/rad]",
    "guard.requested.damping": "B [N·m·s/rad]",
    "guard.commanded.stiffness": "K, without a probe under way [N·m/rad]",
    "guard.commanded.damping": "B, likewise [N·m·s/rad]",
    "guard.limit": "limits of K at the commanded B, by name [N·m/rad]; null: does not apply",
    "guard.damping_ceiling": (
        "above it no stiffness is stable; with a fast link a lower bound of that, lower at a small"
        " B [N·m·s/rad]"
    ),
    "guard.encoder_damping": "above it one encoder count commands too much [N·m·s/rad]",
    "guard.margin": "fraction of the smallest limit that K may reach",
    "guard.binding": "name of the limit that lowered K; null if K is as requested",
    "guard.reasons": "sentences: what is commanded, why, and remedies",
    "guard.assumed": "assumed gear train and horn, and the link from which this is wrong; or null",
    "guard.interval_s": "the served interval that counted as the period [s]",
    "guard.velocity_filter": "`kind`, `frequency_hz` (at that interval), `q`; null: none",
    "guard.only_friction": "the wall is stable only because of Coulomb friction (mode `off`)",
    "oscillation": "findings of the watch, before the wall was reduced",
    "oscillation.state": "the worst of `quiet`, `decaying`, `sustained`, `growing`",
    "oscillation.frequency_hz": "of the largest motion in that state [Hz]; null: none",
    "oscillation.amplitude_rad": "of that motion [rad]; null: none",
    "oscillation.first_alarm_s": "from the first sample with the wall on to the first alarm that no"
    " probe withdrew [s]; null: none",
    "oscillation.probes": "number of probes",
    "oscillation.probed_s": "time in which the wall was softer for them [s]",
    "oscillation.reduced_to.stiffness": "fraction of elastic torque, and of its limit, left at the"
    " end",
    "oscillation.reduced_to.damping": "fraction of the damping left at the end",
    "torque.max": "largest torque sent [N·m]",
    "torque.saturated_ticks": "ticks in which the torque limit or `wall.torque_clip` cut it",
    "axes": "of several axes, by name: `guard`, `oscillation`, `torque`, `wall_came_on`, `delay_s`"
    " and `bus` of each. At the top `guard` is then null, `oscillation` the worst axis's, `torque`"
    " and `delay_s` the largest, `wall_came_on` of all, `bus` the sum",
    "stop_reason": "`duration`, `interrupted`, or `trip:NAME`",
    "stop_axis": "the axis whose trip ended the run; null: not one axis's, or there is one servo",
    "explanation": "meaning and remedy of a trip",
    "wall_came_on": "whether the wall came on",
    "waited_for": "the condition that a wall waited for which never came on",
    "no_stiffness": "why a wall had no stiffness for most of its time; null: it had some",
    "torque_off": "loop or supervisor read torque off back",
    "servo_checks": "start-up checks: `name`, `ok`, `found`, `wanted`, `fix`",
    "realtime": "real-time settings: the same keys",
    "warnings": "notes",
    "changes": "the last 1000 requested changes: `at_s` (since the first row), `row`, `outcome`"
    " (`applied`, `refused`, `not applied`), `why`, `set`, `changed`, `waited_s`, `commanded`",
    "log": "path of the log",
    "log_state": "`whole`; `incomplete`: rows, or how the run ended, are missing; `missing`: not"
    " written, removed or moved; `none`: the run ended before its first row",
    "plot": "path of the picture",
}
