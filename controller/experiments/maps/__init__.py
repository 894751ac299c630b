"""Maps the region where walls oscillate, by simulating many walls at once."""
