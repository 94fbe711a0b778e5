"""Bytes, lines and commands between driver and controller.

In the order in which data walks through:

    clock       time as the controller counts it
    transport   bytes to and from a serial port: the only place that opens one
    transcript  a record of what went over the line
    patience    a silent line opened anew and asked again
    framing     bytes into lines, and the lines of TOUCH/1 with their checksums
    link        stop-and-wait: one numbered command, one answer, a fed deadman
    controller  what a robot controller can be asked, and its answers
"""
