"""Simulates the plant: exact motion of a servo, an operator model, an encoder."""
