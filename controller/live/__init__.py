"""Shows a run in a browser: a server in its own process, and the page that it serves."""
