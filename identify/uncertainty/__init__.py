"""What is known of all unknowns, and what that promises of the tip in the weld zone.

In the order in which data walks through:

    information      rows of the Jacobian in a whitened identifiable basis, and their sum
    promise          the tip error to expect in the weld zone
    assurance        what the touches that were made promise, and what more of them could
    weak_directions  what planned touches do not show, in words, and which touches would show it
    zone_map         the tip error to expect over the weld zone
"""
