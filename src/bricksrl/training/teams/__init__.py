"""Teams: groups of robots in one world, which learn together."""
