"""The detector: judges whether the wall oscillates by itself, and answers it."""
