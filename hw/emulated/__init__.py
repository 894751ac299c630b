"""An emulated Dynamixel bus, exact to the byte: wire, adapter, servos, faults and witness."""
