"""Sensors on the computer beside the robot: their description, what reads them, and devices that
come with BricksRL."""
