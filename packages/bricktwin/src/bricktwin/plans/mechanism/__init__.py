"""Mechanism of a plan: hinges, gear trains, closed loops, poses, end stops."""
