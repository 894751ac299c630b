"""Logs: writes them block by block, reads them past damage, exports and analyses them."""
