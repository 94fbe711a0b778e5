"""CasADi functions evaluated at many points at once.

In the order in which data walks through:

    batch       one compiled function at many points, NumPy arrays in and out
    vectorized  each elementary operation of a function done on a column of numbers
"""
