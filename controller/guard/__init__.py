"""The guard: which stiffness and damping are stable for what is believed of the servo."""
