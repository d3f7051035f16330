"""What robots did, kept for good."""
