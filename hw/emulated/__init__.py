"""An emulated Dynamixel bus, down to the bytes."""
