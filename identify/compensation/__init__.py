"""From wanted poses to joints and command poses that bring the true tip there.

In the order in which data walks through:

    postures    postures of a nominal robot for poses without a start
    ipopt       inverse kinematics within joint limits, a small NLP a target
    trust       which corrections to trust
    compensate  corrected joints and command poses
    fitting     the parameters that a format can carry, fitted to an identified robot
    ladder      what each way of applying a calibration gives on this robot
"""
