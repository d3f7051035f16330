"""Teams: groups of robots in one world that learn together."""
