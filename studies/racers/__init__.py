"""One module a library of the race of `studies.peers`, run by `child.py` in an interpreter that may lack the others.

A racer has METHODS: functions of a problem (arrays by name, see `peers_problems`) that return arrays by name, the `tip`
at the unseen poses, or the `indices` and `weights` of the chosen rows. Only touchcal's own racer and the problems
import something of touchcal.

In the order in which data walks through:

    racing         a race: one problem, each racer in a process of its own
    peers_problems  the problems of the race
    child          one method of one racer on one problem, again and again: answers, time and memory
    with_touchcal  ours, and SciPy's solver with our equations and derivatives
    with_scipy     SciPy's least_squares on the equations of a touch in NumPy
    with_pybotics  modified Denavit-Hartenberg parameters, fitted as in the example of pybotics
    with_figaroh   calibration by BaseCalibration on a URDF, selection by its SOCP and its Detmax
    with_cvxpy     the D-optimal weights as a convex program, by cvxpy with Clarabel
"""
