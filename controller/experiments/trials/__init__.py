"""Closed-loop trials: runs the loop's own tick on servos that are worse than the belief."""
