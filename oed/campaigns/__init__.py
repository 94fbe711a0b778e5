"""Touch, identify and plan by turns.

In the order in which data walks through:

    stages         the stages of a campaign, and the store that keeps them
    more_touches   what more touches would promise, and how many a target takes
    campaign       the loop: touch, identify, plan the next touches, until the promise is good
    connection     from a port and a protocol to a session of touches
    folder         the stages of a campaign as files in a folder, and their touches made over a port
    demonstration  the whole loop on the embedded virtual robot
"""
