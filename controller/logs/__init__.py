"""Logs: written block by block, read past damage, cut, exported, looked through again."""
