"""Features of observations that networks read, and the encoder that computes them."""
