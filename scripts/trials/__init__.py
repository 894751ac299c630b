"""Trials for the detector's pages: the loop's own tick on servos worse than the belief."""
