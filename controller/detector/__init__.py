"""The detector: does the wall oscillate by itself, and what is done about it."""
