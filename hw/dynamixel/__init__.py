"""The driver of Dynamixel servos over Protocol 2.0, and its tools."""
