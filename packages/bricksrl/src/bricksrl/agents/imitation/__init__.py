"""Imitation learning: behavioural cloning, ACT, diffusion policy."""
