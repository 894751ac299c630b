"""The door of a run: changes from other terminals, the page in a browser, the stream."""
