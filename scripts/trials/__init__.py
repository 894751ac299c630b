"""Closed-loop trials for the pages on the detector: the loop's own tick on servos worse than the belief."""
