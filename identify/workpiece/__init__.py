"""Where a workpiece stands, from touches on its known faces.

In the order in which data walks through:

    placement     where a body with known planes stands, from points on them: all starts at once
    localization  the pose of a workpiece in the base frame, with its uncertainty
"""
