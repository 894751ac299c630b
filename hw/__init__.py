"""Drives or simulates a servo; knows no wall."""
