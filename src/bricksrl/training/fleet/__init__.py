"""Fleets: several robots of one kind that feed one learner, each in a process and in its own time."""
