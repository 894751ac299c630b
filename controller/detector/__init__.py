"""Detects oscillation that the wall itself sustains, and reduces the gains or ends the run."""
