"""What a robot, a jig and a touch are, and the residual that ties them together."""
