"""Rendered laws (wall and program), and the parts that shape their torque."""
