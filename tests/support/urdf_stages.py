"""URDFs as their authors write them, and the transforms that the specification gives them."""

from dataclasses import dataclass
from xml.sax.saxutils import quoteattr

import numpy as np
import pytest
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from identify.model.files import InputError
from identify.model.urdf.chain import read_urdf


@dataclass(frozen=True)
class Stage:
    """One joint of a URDF, as its author writes it: metres, radians."""

    kind: str
    xyz: tuple[float, float, float] = (0.0, 0.0, 0.0)
    rpy: tuple[float, float, float] = (0.0, 0.0, 0.0)
    axis: tuple[float, float, float] = (0.0, 0.0, 1.0)

    def origin(self):
        T = np.eye(4)
        T[:3, :3] = Rotation.from_euler("xyz", self.rpy).as_matrix()  # about fixed axes: roll, then pitch, then yaw
        T[:3, 3] = self.xyz
        return T

    def motion(self, value):
        """The transform of a joint value [rad] or [m]."""
        T, axis = np.eye(4), np.array(self.axis) / np.linalg.norm(self.axis)
        if self.kind == "prismatic":
            T[:3, 3] = axis * value
        else:
            T[:3, :3] = Rotation.from_rotvec(axis * value).as_matrix()
        return T

    def xml(self, name, parent, child):
        numbers = {
            key: quoteattr(" ".join(repr(float(v)) for v in getattr(self, key))) for key in ("xyz", "rpy", "axis")
        }
        limit = '<limit lower="-1.5" upper="2" velocity="1.25" effort="9"/>' if self.kind != "fixed" else ""
        return (
            f'<joint name="{name}" type="{self.kind}"><parent link="{parent}"/><child link="{child}"/>'
            f"<origin xyz={numbers['xyz']} rpy={numbers['rpy']}/><axis xyz={numbers['axis']}/>{limit}</joint>\n"
        )


def urdf(stages):
    """A URDF whose links are called L0, L1, ..., with a side branch and out of order."""
    joints = [stage.xml(f"arm.{i}", f"L{i}", f"L{i + 1}") for i, stage in enumerate(stages)]
    links = "".join(f'<link name="L{i}"/>\n' for i in range(len(stages) + 1))
    branch = '<link name="camera"/>\n' + Stage("fixed", (9, 9, 9)).xml("mount", "L1", "camera")
    return f'<?xml version="1.0"?>\n<robot name="any">\n{"".join(reversed(joints))}{branch}{links}</robot>\n'


def semantics(stages, q):
    """Forward kinematics straight from the specification of URDF, lengths turned to mm at the end."""
    T, values = np.eye(4), iter(q)
    for stage in stages:
        T = T @ stage.origin()
        if stage.kind != "fixed":
            T = T @ stage.motion(next(values))
    T[:3, 3] *= 1000
    return T


right_angles = st.sampled_from([0.0, np.pi / 2, -np.pi / 2, np.pi])
small = st.sampled_from([1e-12, 1e-7, -1e-4, 1.5708, np.radians(4.999), np.radians(5.001), -np.radians(175.001)])
turns = st.tuples(*[right_angles | right_angles | small | st.floats(-3.2, 3.2)] * 3)
shifts = st.tuples(*[st.sampled_from([0.0, 0.0, 0.35, -0.06, 1e-9]) | st.floats(-2, 2)] * 3)
along = st.sampled_from([tuple(row) for row in np.vstack([np.eye(3), -np.eye(3)]).tolist()])
slanted = st.tuples(*[st.floats(-5, 5)] * 3).filter(lambda v: np.linalg.norm(v) > 1e-3)
fixed = st.builds(Stage, st.just("fixed"), shifts, turns)
moving = st.builds(Stage, st.sampled_from(["revolute", "continuous", "prismatic"]), shifts, turns, along | slanted)
chains = st.lists(moving | moving | fixed, min_size=1, max_size=9).filter(lambda c: any(s.kind != "fixed" for s in c))


def written(folder, text, name="robot.urdf"):
    path = folder / name
    path.write_text(text, encoding="utf-8")
    return path


def model(folder, stages):
    return read_urdf(written(folder, urdf(stages)), "L0", f"L{len(stages)}")


def assert_same(T, expected, stages):
    reach = 1000 * (1 + sum(np.linalg.norm(s.xyz) + 4 for s in stages))  # [mm]
    np.testing.assert_allclose(T[:3, 3], expected[:3, 3], rtol=0, atol=1e-12 * reach)  # 1e-9 mm for a metre
    np.testing.assert_allclose(T[:3, :3], expected[:3, :3], rtol=0, atol=1e-11)


def mistakes(folder, text, base="a", flange="c"):
    with pytest.raises(InputError) as caught:
        read_urdf(written(folder, text), base, flange)
    return [(m.line, m.text) for m in caught.value.mistakes]
