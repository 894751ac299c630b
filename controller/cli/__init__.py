"""The command line: a file per command, and their shared parts."""
