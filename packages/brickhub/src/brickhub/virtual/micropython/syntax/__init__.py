"""Program text: what differs from Python is rewritten before it is compiled."""
