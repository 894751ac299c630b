"""The acceptance of a real servo: predictions first, then measurements, then one bundle."""
