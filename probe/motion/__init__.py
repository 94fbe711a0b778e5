"""How the arm moves without hitting anything.

In the order in which data walks through:

    settings       speeds, waits, tolerances and limits of patience
    distances      distances of many segments at once, from boxes and from each other, and bounds on them
    clusters       groups of triangles, for bounding volumes tighter than one around a mesh
    obstacles      the solids of jig and cell, or the faces of a jig without solids
    torch          the torch as capsules on the last link
    bodies         the solids of an arm as its URDF describes them, each with a capsule around it
    mesh_distance  exact distances of meshes, boxes, cylinders, spheres and capsules, by `coal`
    confirmation   whether shapes come too near where the capsules around them do
    link_pairs     which capsules of an arm could hit each other
    clearance      clearance of arm and torch from jig, table and the arm itself
    joint_path     the motions of one touch, from joint values of a plan
    edges          ways between touches: straight in joint space, over lifted postures where they must
    tour           the order of touches, and the minutes that it takes
    roadmap        a short order of touches along clear ways
    room           the one room that judges motions, for planner and driver alike
"""
