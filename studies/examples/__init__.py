"""Short programs to start from: each below 40 lines, each runs in the tests, `python -m studies.examples.NAME`.

In the order in which data walks through:

    plan_notebook       a plan looked at and touched by a hidden robot, cell by cell of a notebook
    own_criterion       a criterion of one's own, compared with V
    own_joint_error     a joint error of one's own, identified
    own_measurement     a kind of measurement of one's own, identified from
    own_controller      a controller of one's own, run over a line
"""
