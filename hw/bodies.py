"""Exact motion of many one-axis servos at once under held torques; the array form of ``plant``."""
