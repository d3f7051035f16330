"""Abilities: what a robot can learn that is known from its building plan alone."""
