"""Examines a testbed: each check gives the found and the wanted value, and the fix."""
