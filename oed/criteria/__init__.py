"""What makes one set of touches better than another: one object a criterion.

In the order in which data walks through:

    swaps              what a criterion gains when one touch is swapped for another; closed form for D and traces
    first_order_swaps  the same to first order, for a criterion without a formula of its own
    criterion          what a criterion is: value, concave function, slope, curvature, support, swaps
    eigenvalues        criteria of the eigenvalues of the information: O1 to O5, D, E
    variances          criteria of predicted variances: A, V, G
    criteria           the table: published functions, one row each
    own                criteria of one's own, defined by a Python file
"""
