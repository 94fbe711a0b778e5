"""Questions, each answered by one script."""
