"""Reproduces table and figures of the paper (Gil et al., ICRA 2007), in theory and simulation."""
