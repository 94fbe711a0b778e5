"""Chosen touches moved continuously, and the bound over the whole manifold.

In the order in which data walks through:

    nlp           one touch as CasADi symbols: its row and its constraints
    coordinate    touches moved one by one
    certificate   column generation: polished touches join the candidates, and bound what any touches could be
"""
