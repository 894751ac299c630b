"""Closed-loop trials: the loop's own tick on servos that are worse than the believed one."""
