"""From a plan to touches, over a serial line."""
