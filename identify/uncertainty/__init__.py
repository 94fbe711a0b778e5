"""What is known of all unknowns, and what that promises of the tip in the weld zone.

In the order in which data walks through:

    named            frames of further placements and tools, and points, that rows name
    unknowns         everything that may differ from drawing and files: one vector in units of prior deviations
    information      the square root of the information about it, grown by QR; variances and draws
    compression      rows of candidate touches in fewer coordinates, without loss
    promise          the tip error in the weld zone that 95 of 100 robots stay below at 95 % of the poses
    zone_map         the expected tip error at points of the zone
    weak_directions  what planned touches do not show, in words
    knowledge        identifiable parameters before planned touches
    assurance        what touches promise, by identifiable parameters
"""
