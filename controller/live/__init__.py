"""The door of a run: changes from other terminals and the page in a browser."""
