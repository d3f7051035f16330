"""Building plans: from an LDraw file to connections, bodies and hinges, parts list and building steps."""
