"""From a URDF to a robot and its solids.

In the order in which data walks through:

    document  elements with their lines, and the numbers in them
    axes      link parameters from the axes of a chain at zero
    chain     the robot between two links
    ends      base and flange of an arm, by geometry
    shapes    collision shapes on the links of that robot
"""
