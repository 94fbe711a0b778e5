"""Programs of robot makers: positions found, corrected and written back in place, everything else as it was."""
