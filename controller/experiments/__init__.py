"""Experiments on walls: many simulated at once, or one servo measured run after run."""
