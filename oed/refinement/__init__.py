"""Chosen touches moved continuously, and the bound over the whole manifold.

In the order in which data walks through:

    nlp           one touch as CasADi symbols: its row and its constraints
    coordinate    touches moved one by one
    simultaneous  all touches moved at once, with the Hessian in closed form
    certificate   how good a plan is against the best that any touches could be
"""
