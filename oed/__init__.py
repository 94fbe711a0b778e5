"""From the model to a plan, the closed loop, and the command line."""
