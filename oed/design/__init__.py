"""Designs over many candidates: best weights, and the best n touches.

In the order in which data walks through:

    matrix             candidate rows, their information, and what each would add to it
    weight_limits      admissible weights: caps, and shares of faces
    owners             candidates of several rows, one weight for all rows of one
    restricted_master  best weights of a few hundred touches, by a primal-dual interior point method
    column_generation  a restricted master holds some candidates, all are priced with its answer
    relaxation         approximate designs with a bound that nothing beats
    constraints        which sets of touches are allowed
    problem            an exact design problem, checked
    robust             swaps judged by several robots at once
    memetic            a search over sets: descents by swaps, recombined
    exact              exact designs: the n touches that tell the most
    budget             exact designs of measurements of several rows and of different costs, for a budget
"""
