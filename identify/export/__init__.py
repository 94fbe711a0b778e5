"""The calibrated robot for other tools; a format is one file with a FORMAT and one row in `exporting.FORMATS`.

In the order in which data walks through:

    formats     what every format gives
    chain       a calibrated chain as constant transforms with motions along or about z between them
    plain_json  what robot.yaml holds, with base and tool, as JSON
    dh          Denavit and Hartenberg's four parameters, fitted where the model has five
    mastering   joint zeros, tool frame and base frame as text
    ur_yaml     `kinematics:` as the description of a UR arm reads it
    urdf_text   the text of a URDF with the places of its joints
    urdf        an existing URDF corrected in place, or a plain one
    exporting   write a format, read it again, and say how far apart the two are
"""
