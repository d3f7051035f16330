"""Replay buffers: TorchRL's, of single transitions and of whole episodes."""
