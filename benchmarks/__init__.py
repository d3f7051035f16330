"""Benchmarks: what is behind each number of the documentation. `python -m benchmarks` lists
them."""
