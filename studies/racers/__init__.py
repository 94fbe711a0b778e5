"""One module a library of the race of `studies.peers`, run by `child.py` in an interpreter that may lack the others.

A racer has METHODS: functions of a problem (arrays by name, see `studies.peers_problems`) that return arrays by name,
the `tip` at the unseen poses, or the `indices` and `weights` of the chosen rows. Nothing of touchcal is imported here,
but by its own racer.
"""
