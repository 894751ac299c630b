"""The processes of a run: supervisor, loop, recorder, door, emulated bus."""
