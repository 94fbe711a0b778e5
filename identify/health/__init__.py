"""Whether a robot is still the one that was identified.

In the order in which data walks through:

    causes  what may have changed: single parameters, and parts that a hit or a slip moves
    judge   unchanged, drifted or broken; by how much and how surely
"""
