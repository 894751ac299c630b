"""One run: deadlines, tick, gains, safety, telemetry, real-time settings, lateness."""
