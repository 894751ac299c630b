"""Measures the stiffness at which a wall begins to oscillate."""
