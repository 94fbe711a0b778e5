"""What is known of all unknowns, and what that promises of the tip in the weld zone.

In the order in which data walks through:

    named_unknowns   frames of further placements and tools, and points, that rows name
    unknowns         everything that may differ from drawing and files: one vector in units of prior deviations
    information      the square root of the information about it, grown by QR; variances and draws
    coordinates      the few coordinates in which touches are compared: all unknowns without loss, or the identifiable
    promise          the tip error in the weld zone that 95 of 100 robots stay below at 95 % of the poses
    posterior        what a calibration says of all unknowns, and what it promises
    weak_directions  what planned touches do not show, in words, and which touches would show it
    zone_map         the tip error to expect over the weld zone
"""
