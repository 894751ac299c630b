"""One run: deadlines, tick, safety, telemetry, real time, lateness."""
