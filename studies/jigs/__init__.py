"""What the study of the jig is made of.

In the order in which data walks through:

    two_places  touches of a jig at two places
    jig_shown   what the study of the jig found, in words and in pictures
"""
