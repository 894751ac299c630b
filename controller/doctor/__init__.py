"""Is this testbed fit for a wall? Checks with what was found, what was wanted, and the fix."""
