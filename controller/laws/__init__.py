"""Laws that can be rendered, wall and program, and the parts that shape their torque."""
