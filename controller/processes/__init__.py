"""The processes of a run: supervisor, loop and recorder."""
