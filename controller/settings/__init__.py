"""Settings: the configuration of a run, read and checked."""
