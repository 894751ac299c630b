"""Decides which stiffness and damping may be commanded, from the believed servo values."""
