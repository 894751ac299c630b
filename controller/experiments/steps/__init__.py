"""Torque steps against the wall, and what the motion after them tells."""
