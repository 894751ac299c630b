"""Maps of where walls oscillate, by the simulation of many walls at once."""
