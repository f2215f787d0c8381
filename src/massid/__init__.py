"""massid: weighs the links of a humanoid robot while the robot walks."""
