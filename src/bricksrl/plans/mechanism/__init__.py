"""The mechanism of a plan: what turns against what, gear trains, closed loops, poses, end stops."""
