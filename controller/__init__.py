"""Decides the torque of a virtual wall; knows no serial port."""

__version__ = "0.1.0"
