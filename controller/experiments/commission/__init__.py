"""Commissioning a testbed: examine, identify, measure, and say how stiff it can be and why."""
