"""Pictures and pages: one self-contained HTML file of a calibration or a plan, and nothing to fetch."""
