"""One session: deadlines, cycle and axes, gains, safety, telemetry, real-time settings."""
