"""Programs of robot makers: positions found, corrected and written back in place.

In the order in which data walks through:

    source       a program as text whose every character is one byte of the file
    numbers      numbers in a program, and others in their place
    records      what the programs of all makers share: a position, its frame, tool and posture
    fanuc        FANUC TP programs (.LS)
    kuka_values  structures of KUKA programs with the place of every number
    kuka_frames  which tool and base hold for a KUKA position
    kuka         KUKA programs (.dat, .src)
    abb_data     aggregates of RAPID with the place of every number
    abb_frames   which tool and work object a RAPID target is used with
    abb          ABB RAPID modules (.mod)
    yaskawa      Yaskawa jobs (.JBI)
    makers       the table of makers: one row each
    backups      frames and tools in what controllers back up
    setup        what a program does not say: frames, tools, how joints are counted
    frames_and_tools  frames and tools of positions
    posture      in which posture a nominal robot reaches a position
    correction   positions that bring the identified robot where the program wants it
    orientation  the nearest of all ways to write an orientation
    writing      corrected numbers in place of the old ones, and nothing else changed
    fixing       whole programs, and a list of what stays uncorrected
"""
