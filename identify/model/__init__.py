"""What a robot, a jig and a touch are, and the residual that ties them together.

In the order in which data walks through:

    files            text files: every mistake with its file and line, and nothing half-written
    io               YAML and CSV files and their contents, both ways
    urdf             from a URDF to a robot and its solids
    compiled         CasADi functions evaluated at many points at once
    frames           rigid transforms as 4 x 4 matrices, R = Rz Ry Rx
    meshes           triangles from STL and OBJ files
    shape            solids that move with the links of a robot
    joint_error_models  models of joint errors: one function and one row of ERROR_MODELS each
    joint            one joint of a serial robot, its five link parameters, and the capsule around a link
    joint_counting   how a controller counts the joints: signs, zeros, couplings, pulses
    robot            a serial robot: its joints, and the names of all parameters
    jig              rectangular faces at known places, and boxes to keep clear of
    touch            touches on faces and positions of the tip, as columns of equal length
    zone             the weld zone: the poses where accuracy counts
    cell             robot, jig, base, tool, wire, priors, controller
    kinematics       the tip in CasADi symbols, equations (1) to (5), and the functions compiled from them
    equations        the equations of measurements in CasADi symbols, for all rows at once
    measurement      kinds of measurements: touch, position, pose, distance, contact, and their rows
    calibration      a robot identified: parameters, covariance, noise, findings
    identifiability  which parameters touches can tell apart: structural elimination, rank, weak directions
    base_placement   where a robot stands well before a jig, how it is parked there, and the cell to start from
    ik_step          one damped step of inverse kinematics as a compiled function
    ik               inverse kinematics of any robot, calibrated or not, for all targets at once
"""

import sys
from collections.abc import Callable, Mapping
from importlib import import_module
from importlib.util import find_spec
from typing import Any


def front(package: str, modules: Mapping[str, str]) -> tuple[Callable[[str], Any], Callable[[], list[str]]]:
    """`__getattr__` and `__dir__` of a package that shows names of its modules, and has its rooms as attributes."""
    home = {name: f"{package}.{module}" for module, names in modules.items() for name in names.split()}

    def load(name: str) -> Any:
        if name in home:
            return getattr(import_module(home[name]), name)
        if not name.startswith("_") and find_spec(f"{package}.{name}"):
            return import_module(f"{package}.{name}")
        raise AttributeError(f"module '{package}' has no attribute '{name}'")

    def names() -> list[str]:
        return sorted({*vars(sys.modules[package]), *home})

    return load, names
