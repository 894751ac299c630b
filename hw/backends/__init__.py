"""The servo backends that come with the program, one file each, registered like outside ones."""
