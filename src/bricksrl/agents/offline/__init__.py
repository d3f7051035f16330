"""Algorithms that learn from a dataset: IQL, CQL, TD3+BC."""
