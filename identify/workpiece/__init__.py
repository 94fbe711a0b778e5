"""workpiece."""
