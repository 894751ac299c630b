"""Sections of ``haptic-wall bench``: a module each, with one function that returns rows."""
