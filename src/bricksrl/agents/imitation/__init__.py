"""Imitation of a dataset: behavioural cloning, ACT, diffusion policy."""
