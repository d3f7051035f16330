"""Fleets: several robots of one kind with one learner, each in its own process and time."""
