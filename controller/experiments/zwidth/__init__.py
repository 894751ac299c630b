"""The Z-width of a servo: which stiffness and damping it can render, and over which frequencies."""
