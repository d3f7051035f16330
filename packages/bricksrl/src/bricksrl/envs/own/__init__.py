"""Environments with resets, steps and a client program of a user's own."""
