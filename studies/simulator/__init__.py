"""Robots and touches simulated by code that shares no line with what is judged.

In the order in which data walks through:

    touching  touches of a robot by kinematics of their own
    faults    faults on purpose: gross errors, wrong face names, a jig worse than stated
"""
