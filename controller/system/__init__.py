"""Files, signals and orders: the services of Linux that every command uses."""
