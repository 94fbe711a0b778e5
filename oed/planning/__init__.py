"""Plans: the touches that tell the most where it matters, in the order of making them.

In the order in which data walks through:

    searches       what robots drawn from what is known meet and learn with planned touches
    candidate_set  all touches that can be made, what each would tell, and the zone
    visitable      the best touches that the robot can also visit one after the other
    strategies     optimal, even and random
    uncertain      touches for a badly known robot, visited on ways that are clear for nearly all that it may be
    curve          how accurate more or fewer touches would make the robot
    plan           the plan, and what to expect of it
    unseen         touches to verify with, away from those of the fit
    health_check   a dozen touches that tell slips, knocks and shifts apart
    kinds_problem  measurements of several kinds that can be made, and designs over all of them
    kinds          measurements of several kinds for a budget of minutes
    workpiece      touches that locate a workpiece
"""
