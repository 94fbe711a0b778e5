"""Robot controllers by the protocol they speak."""
