"""Decides the torque of a virtual wall; knows no serial port."""
