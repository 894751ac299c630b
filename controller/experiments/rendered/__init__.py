"""Measures the wall that is rendered: stiffness, damping and drag."""
