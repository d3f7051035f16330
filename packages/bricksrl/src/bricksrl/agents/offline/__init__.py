"""Algorithms that learn from recorded data."""
