"""What is rendered: wall and program, and what shapes their torque."""
