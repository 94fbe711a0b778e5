"""Bytes, lines and commands between driver and controller.

In the order in which data walks through:

    clock       time as the controller counts it
    transport   bytes to and from a serial port: the only place that opens one
    transcript  a record of what went over the line
    retry       how long the host waits; a silent line opened anew and asked again
    framing     bytes into lines, and the lines of TOUCH/1 with their checksums
    messages    the greeting, a status, an answer, read from lines of TOUCH/1
    watch       reported positions of a motion against what was commanded
    link        stop-and-wait: one numbered command, one answer, a fed deadman
    controller  what a robot controller can be asked, and its answers
"""
