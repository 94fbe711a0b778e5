"""The calibrated robot for other tools; a format is one file with a FORMAT and one row in `exporting.FORMATS`."""
