"""A virtual robot cell: a robot whose true parameters are hidden, a jig to touch, and a serial port before both.

`truth` says what is hidden, `batch.touch_batch` makes all touches of a plan at once, `robot.VirtualRobot` moves in
time, `server.serve` puts it behind a port, and `command.run` does so until somebody ends it.
"""
