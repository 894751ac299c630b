"""Files, signals and terminals: the services of Linux that every command uses."""
