"""Experiments on walls: simulated many at once, or run one after the other."""
