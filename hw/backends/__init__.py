"""The servo backends that come with the program: a file each, as an outside one would be."""
