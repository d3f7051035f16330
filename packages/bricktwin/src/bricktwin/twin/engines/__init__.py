"""Engine under a body: its interface, its implementation by MuJoCo, and what both share."""
