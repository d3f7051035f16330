"""Building plans: LDraw files, connections, bodies and joints, parts lists, building steps."""
