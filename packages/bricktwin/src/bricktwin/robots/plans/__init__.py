"""Building plans of the robots of this package, as LDraw files."""
