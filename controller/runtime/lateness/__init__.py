"""Why a tick was late: what the machine was set to, and what it did meanwhile."""
