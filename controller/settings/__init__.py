"""Settings: what a run is asked to be, read and checked."""
