"""The processes of a run: supervisor, loop, recorder, streamer and dead man's watcher."""
