"""Simulates the plant: exact motion of one servo or of many, an operator model, an encoder."""
