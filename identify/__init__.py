"""From touches to parameters, their uncertainty, and what they change.

The front, loaded when it is used:

    read_cell(path), read_robot, read_jig, library       what cell, robot and jig files describe
    read_measurements(path, cell), read_plan             measurements of any kind (read_touches, read_positions), plans
    calibrate(cell, *measured)                           a Calibration; read_calibration, write_calibration
    zone_promise(calibration)                            the tip error to expect in the weld zone, a Promise
    verify(calibration, *measured)                       errors where the fit has not looked, a Verification
    compensate(calibration, poses)                       joints and command poses, a Compensation
    fix, locate, judge                                   programs, workpieces, health
    Cell, Plan, Touches, Positions, InputError           what these functions take and raise; touches_text, plan_text

Its rooms, in the order in which data walks through:

    model         what is described: robot, joint errors, jig, touch, measurement, cell, weld zone; files in and out
    uncertainty   what is known of all unknowns, and what that promises of the tip
    estimation    from measurements to parameters
    compensation  from wanted poses to joints and command poses that bring the true tip there
    workpiece     where a workpiece stands
    health        whether a robot is still the one that was identified
    programs      robot programs corrected in place
    export        the calibrated robot for other tools
    pendant       whether the model means what the pendant shows
    report        pages and pictures of calibrations and plans
"""

from typing import TYPE_CHECKING

from identify.model import front

if TYPE_CHECKING:
    from identify.compensation.compensate import Compensation as Compensation
    from identify.compensation.compensate import compensate as compensate
    from identify.estimation.calibrate import calibrate as calibrate
    from identify.estimation.verification import Verification as Verification
    from identify.estimation.verification import verify as verify
    from identify.health.judge import judge as judge
    from identify.model.cell import Cell as Cell
    from identify.model.files import InputError as InputError
    from identify.model.io.calibration_file import Calibration as Calibration
    from identify.model.io.calibration_file import read_calibration as read_calibration
    from identify.model.io.calibration_file import write_calibration as write_calibration
    from identify.model.io.description import library as library
    from identify.model.io.description import read_cell as read_cell
    from identify.model.io.description import read_jig as read_jig
    from identify.model.io.description import read_robot as read_robot
    from identify.model.io.measurements import read_measurements as read_measurements
    from identify.model.io.tables import plan_text as plan_text
    from identify.model.io.tables import read_plan as read_plan
    from identify.model.io.tables import read_positions as read_positions
    from identify.model.io.tables import read_touches as read_touches
    from identify.model.io.tables import touches_text as touches_text
    from identify.model.touch import Plan as Plan
    from identify.model.touch import Positions as Positions
    from identify.model.touch import Touches as Touches
    from identify.programs.fixing import fix as fix
    from identify.uncertainty.posterior import zone_promise as zone_promise
    from identify.uncertainty.promise import Promise as Promise
    from identify.workpiece.localization import locate as locate

_FRONT = {
    "model.files": "InputError",
    "model.cell": "Cell",
    "model.touch": "Plan Positions Touches",
    "model.io.calibration_file": "Calibration read_calibration write_calibration",
    "model.io.description": "library read_cell read_jig read_robot",
    "model.io.measurements": "read_measurements",
    "model.io.tables": "plan_text read_plan read_positions read_touches touches_text",
    "estimation.calibrate": "calibrate",
    "estimation.verification": "Verification verify",
    "compensation.compensate": "Compensation compensate",
    "workpiece.localization": "locate",
    "health.judge": "judge",
    "programs.fixing": "fix",
    "uncertainty.posterior": "zone_promise",
    "uncertainty.promise": "Promise",
}
if not TYPE_CHECKING:
    __getattr__, __dir__ = front(__name__, _FRONT)
