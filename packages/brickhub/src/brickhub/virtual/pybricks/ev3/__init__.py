"""EV3 Brick: its devices, its screen, and their modes."""
