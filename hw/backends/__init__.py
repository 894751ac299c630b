"""The servo backends, one file each."""
