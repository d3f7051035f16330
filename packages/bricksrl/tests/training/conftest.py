"""Fixtures of training tests."""

import torch

# fills memory that nobody wrote with NaN: whoever reads it is found out
torch.use_deterministic_algorithms(True, warn_only=True)
