"""Offline algorithms: IQL, CQL, TD3+BC."""
