"""Pictures, pages and sentences about runs, experiments and theory."""
