"""Fixtures of training tests."""

import torch

torch.use_deterministic_algorithms(True, warn_only=True)  # fills memory that nobody wrote with NaN: whoever reads it is found out
