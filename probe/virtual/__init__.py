"""A virtual robot cell: a robot whose true parameters are hidden, a jig to touch, and a serial port before both."""
