"""Pictures: of runs, and of what experiments and mathematics found."""
