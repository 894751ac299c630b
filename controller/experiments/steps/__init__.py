"""Applies torque steps to a servo, and fits lag, acceleration and friction to its motion."""
