"""The run of a plan: touches made, judged, remembered.

In the order in which data walks through:

    preflight   the whole plan checked before the first motion
    rehearsal   a dry run: every approach at a safe distance, and no touch
    lock        one program at a time
    journal     records that survive a kill at any byte
    records     what a session remembers: motions, readings, results
    repair      rows that only touches.csv knows, and which of them can be believed
    session     one plan being touched, over as many runs as it takes
    prediction  where the next touch should be, by all touches so far
    acceptance  when a touch counts
    retreat     every single motion, and the way back from where one ended
    attempt     one attempt at one touch, from its approach to its retract
    events      what happens, for a screen or a log to show
    execution   which touch comes next, which counts, and when to stop
    delay       the delay of the touch signal, from touches at two speeds
"""
