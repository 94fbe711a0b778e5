"""The touches and the other measurements that can be made.

In the order in which data walks through:

    edge_margins  how far to stay from the edges of a face
    targets       contacts to ask for: corners, edges and insides of faces, with leans and turns of the wire
    ik_branches   all branches of the inverse kinematics of many poses
    feasibility   whether a touch can be made: contact, way from the approach, search beyond
    hits          what robots that may be off meet with a search
    candidates    contact points, wire, joint values of contact and approach
    sight         lines of sight from a tracker to the target at the tip
    kinds         positions, poses, distances and contacts that can be measured
    baselines     points spread evenly over the faces, and random ones
"""
