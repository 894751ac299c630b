"""Identifies a servo: inertia, friction, delay and torque constant, with bounds."""
