"""Files, signals and terminals: what every command needs of Linux."""
