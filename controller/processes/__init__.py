"""The processes of a run: the supervisor, the loop, and those who write and tell."""
