"""Logs: writes them block by block, reads, exports and analyses them."""
