"""What makes one set of touches better than another.

In the order in which data walks through:

    criteria  the table: one function and one row each
    concave   concave functions of the information that certify a design
    aim       how a criterion grows with a rank-one update of the information
"""
