"""Examines a testbed: checks with the found and wanted values, and the fix."""
