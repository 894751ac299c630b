"""The servo backends that come with the program, one file each, written like outside ones."""
