"""Moves the servo; knows no wall."""
