"""What a person sees: help, progress, touches as they are made.

In the order in which data walks through:

    fold      long lines folded at the width of the screen
    help      what `--help` prints
    progress  how far work has come
    live      touches as they are made
    unknowns  what was measured and identified
"""
