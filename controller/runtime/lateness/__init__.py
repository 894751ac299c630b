"""Explains late ticks: the machine's set-up, and what it did meanwhile."""
