"""From measurements to parameters.

In the order in which data walks through:

    initial_guess     a closed-form start for a base and a tool that nobody measured
    placement_guess   a start for further placements, tools and points that are to be fitted
    gauge             directions that are a choice of frame, and whether any length is known
    problem           the least squares problem of a cell and its touches
    ipopt             Ipopt for many unknowns, compiled once a size
    least_squares     weighted, robust nonlinear least squares with priors
    robust            measurements that agree, and the noise
    starts            starts that survive gross errors and wrong face names
    changes           a wire cut between touches, a slow drift: estimated where residuals show them
    edges             touches so near an edge that they may have met the next face
    faces             faces off their places, and a jig worse than its tolerance
    folds             regions of space to hold out
    selection         which joint errors the touches show
    discrepancy       how large joint errors and noise are on this arm, by regions left out, averaged
    all_joint_errors  the estimate with all joint errors at once
    face_association  the most probable robot while the touches alone do not determine it
    diagnosis         causes that a fit shows: base or tool far off, joints read too early, one bad joint, outliers
    calibrate         from touches to a Calibration
    verdict           whether a calibration may be used, and what to do if not
    verification      errors where the fit has not looked
"""
