"""What can be unknown of a robot and of its sensors, and the spaces that such unknowns span."""
