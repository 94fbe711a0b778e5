"""A virtual robot cell: a robot whose true parameters are hidden, a jig to touch, and a serial port before both.

`truth` says what is hidden, `batch.touch_batch` makes all touches of a plan at once, `robot.VirtualRobot` moves in
time, `server.serve` puts it behind a port, and `command.run` does so until somebody ends it.

In the order in which data walks through:

    truth       what the robot, the jig and the wire really are
    surfaces    what a wire can touch on a jig
    contact     where a wire first meets the jig on its way
    collision   what arm and torch hit
    arm         the arm behind the encoders: play in its gears, noise in its joints
    batch       all touches of a plan at once, without time and without a port
    readings    what devices read, in tables of any kind but touches
    motion      how far along its path a robot is at a time
    records     how motions ended, and what was really touched
    robot       the virtual robot: it moves in time and meets the jig
    faults      spoiled lines, and mishaps of the controller and its wire
    line        the controller's side of TOUCH/1
    gcode       one line of G-code as GRBL takes it
    grbl_state  what a virtual GRBL remembers, and what it says of that
    grbl        a six-axis GRBL 1.1 before the virtual robot
    ports       the controller's end of a serial line
    log         what was executed and truly touched, as JSON lines
    server      a virtual cell behind a port
    command     a virtual cell until somebody ends it
"""
