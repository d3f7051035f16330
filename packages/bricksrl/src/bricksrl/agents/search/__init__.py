"""Policy search: a few numbers of a structured policy, tried on the robot."""
