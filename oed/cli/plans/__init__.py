"""Plans that touchcal plan makes besides touches for a robot.

In the order in which data walks through:

    kinds      measurements of several kinds for a budget of minutes
    workpiece  touches that locate a workpiece
"""
