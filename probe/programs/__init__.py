"""The touches of a plan as a program in a controller's own language, and readers of what such programs log.

In the order in which data walks through:

    options   what an operator may choose
    routine   what a program does for each touch
    log       what a program logged, and the text form of it
    part      one file of a program
    registers numbered registers as controllers save them
    fanuc     TP programs, and position registers
    kuka      KRL modules, and their data lists
    abb       RAPID modules, and their text file
    yaskawa   INFORM jobs, and variables
    ur        URScript, and its socket stream
    page      the page for the operator
    makers    the table: one row a maker
    evidence  which logged touches count
"""
