"""What can be wrong with a log or a robot, put there on purpose."""
