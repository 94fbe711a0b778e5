"""What the YAML files of a user may hold: keys with their units and limits; defaults are those of the model."""

from typing import Annotated, Literal

from pydantic import BaseModel, ConfigDict, Discriminator, Field, Tag

from identify.model.cell import DEG, Controller, Priors, Spacing, TouchSettings, Wire, Zone
from identify.model.io.units import outside, usual
from identify.model.jig import Face
from identify.model.joint import Joint
from identify.model.robot import Robot

Number = Annotated[float, Field(strict=True)]  # not a text that reads like one, nor true or false
Positive = Annotated[Number, Field(gt=0)]
Vector = tuple[Number, Number, Number]
Degrees = Annotated[Number, Field(ge=-360, le=360)]


class Strict(BaseModel):
    """Unknown keys and numbers that are none are mistakes."""

    model_config = ConfigDict(extra="forbid", allow_inf_nan=False, frozen=True)


class PoseEntry(Strict):
    """A frame: Trans(x, y, z) Rz Ry Rx."""

    x_mm: Number = 0.0
    y_mm: Number = 0.0
    z_mm: Number = 0.0
    rz_deg: Number = 0.0
    ry_deg: Number = 0.0
    rx_deg: Number = 0.0


class JointEntry(Strict):
    """One joint of robot.yaml."""

    name: str = ""
    type: Literal["revolute", "prismatic"] = "revolute"
    theta_deg: Number = 0.0
    d_mm: Number = 0.0
    a_mm: Number = 0.0
    alpha_deg: Number = 0.0
    beta_deg: Number = 0.0
    limits_deg: tuple[Number, Number] | None = None
    limits_mm: tuple[Number, Number] | None = None
    speed_deg_s: Positive | None = None
    speed_mm_s: Positive | None = None
    mass_kg: Annotated[Number, Field(ge=0)] = usual(Joint, "mass_kg")
    centre_mm: Vector = usual(Joint, "centre_mm")


class PayloadEntry(Strict):
    """What the flange carries: its mass, and where its centre is in the flange frame."""

    mass_kg: Positive
    centre_mm: Vector = (0.0, 0.0, 0.0)


class CapsuleEntry(Strict):
    """One capsule of robot.yaml: a segment with a radius, in the frame of a link."""

    link: Annotated[int, Field(ge=0)]
    start_mm: Vector
    end_mm: Vector
    radius_mm: Positive


class RobotFile(Strict):
    """robot.yaml."""

    name: str
    source: str = ""
    joints: Annotated[list[JointEntry], Field(min_length=1)]
    capsules: list[CapsuleEntry] = []
    base_to_first: PoseEntry = PoseEntry()
    last_to_flange: PoseEntry = PoseEntry()
    errors: list[str] = []
    error_values: dict[str, Number] = {}
    drawing: list[tuple[Number, Number, Number, Number, Number]] = []  # theta_deg, d_mm, a_mm, alpha_deg, beta_deg
    up: Vector = usual(Robot, "up")
    payload: PayloadEntry | None = None
    temperature_c: Number = usual(Robot, "temperature_c")


class FaceEntry(Strict):
    """One face of jig.yaml."""

    name: Annotated[str, Field(min_length=1)]
    origin_mm: Vector
    u_mm: Vector
    v_mm: Vector
    tolerance_mm: Annotated[Number, Field(ge=0)] = usual(Face, "tolerance_mm")
    tolerance_deg: Annotated[Number, Field(ge=0)] = usual(Face, "tolerance_deg")


class BoxEntry(Strict):
    """One solid block of jig.yaml, along the axes of the jig frame."""

    lower_mm: Vector
    upper_mm: Vector


class ObstacleEntry(Strict):
    """A solid to keep clear of: one of a box, a cylinder along z, and a mesh, with its pose in the jig frame."""

    name: str = ""
    box_mm: tuple[Positive, Positive, Positive] | None = None  # edges, about the middle
    cylinder_mm: tuple[Positive, Positive] | None = None  # radius and length, about the middle
    mesh: str | None = None  # STL or OBJ beside the file
    scale: Positive = 1.0  # [mm] per unit of the mesh
    pose: PoseEntry = PoseEntry()


class JigFile(Strict):
    """jig.yaml."""

    name: str
    source: str = ""
    faces: Annotated[list[FaceEntry], Field(min_length=1)]
    boxes: list[BoxEntry] = []
    obstacles: list[ObstacleEntry] = []


class WireEntry(Strict):
    """The end of the wire."""

    radius_mm: Annotated[Number, Field(ge=0)] = usual(Wire, "radius_mm")
    shape: Literal["point", "ball", "flat"] = usual(Wire, "shape")


class TouchEntry(Strict):
    """How touches are made."""

    sigma_mm: Positive = usual(TouchSettings, "sigma_mm")
    approach_mm: Positive = usual(TouchSettings, "approach_mm")
    travel_mm: Positive = usual(TouchSettings, "travel_mm")
    speed_mm_s: Positive = usual(TouchSettings, "speed_mm_s")
    max_tilt_deg: Annotated[Number, Field(gt=0, le=90)] = usual(TouchSettings, "max_tilt_deg")


class ZoneEntry(Strict):
    """Where accuracy counts, in the jig frame."""

    box_mm: tuple[tuple[Number, Number], tuple[Number, Number], tuple[Number, Number]]
    max_tilt_deg: Annotated[Number, Field(gt=0, le=180)] = usual(Zone, "max_tilt_deg")


class PriorsEntry(Strict):
    """Manufacturing and set-up tolerances, 1 sigma."""

    base_mm: Positive = usual(Priors, "base")[0]
    base_deg: Positive = outside(usual(Priors, "base")[1], DEG)
    tool_mm: Positive = usual(Priors, "tool")[0]
    tool_deg: Positive = outside(usual(Priors, "tool")[1], DEG)
    length_mm: Positive = usual(Priors, "link")[0]
    angle_deg: Positive = outside(usual(Priors, "link")[1], DEG)
    errors: dict[str, Positive] = {}


class ControllerEntry(Strict):
    """The robot controller at the other end of the line."""

    port: str = usual(Controller, "port")
    protocol: str = usual(Controller, "protocol")
    baud: Annotated[int, Field(gt=0)] = usual(Controller, "baud")
    axis_unit_deg: Positive = usual(Controller, "axis_unit_deg")


class UrdfEntry(Strict):
    """A robot described by a URDF: the chain between two of its links, and narrower limits of joints by their names."""

    urdf: str
    base: str
    flange: str
    limits_deg: dict[str, tuple[Number, Number]] = Field(default_factory=dict)
    limits_mm: dict[str, tuple[Number, Number]] = Field(default_factory=dict)


def _by_type(text: str, mapping: str) -> Discriminator:
    return Discriminator(lambda value: text if isinstance(value, str) else mapping)


Frame = Annotated[
    Annotated[PoseEntry, Tag("<frame>")] | Annotated[Literal["fit"], Tag("<fit>")], _by_type("<fit>", "<frame>")
]
RobotSource = Annotated[
    Annotated[str, Tag("<file>")] | Annotated[UrdfEntry, Tag("<urdf>")], _by_type("<file>", "<urdf>")
]


_rows = Discriminator(lambda value: "<names>" if isinstance(value, dict) else "<list>")
Signs = Annotated[
    Annotated[list[Literal[1, -1]], Tag("<list>")] | Annotated[dict[str, Literal[1, -1]], Tag("<names>")], _rows
]
Numbers = Annotated[Annotated[list[Number], Tag("<list>")] | Annotated[dict[str, Number], Tag("<names>")], _rows]
Positives = Annotated[Annotated[list[Positive], Tag("<list>")] | Annotated[dict[str, Positive], Tag("<names>")], _rows]


class JointsEntry(Strict):
    """How the controller counts joints: model = sign * (counts + coupled counts - zero); lists, or by joint name."""

    sign: Signs | None = None
    zero_deg: Numbers | None = None  # what it shows where the model stands at 0; mm of a prismatic joint
    # {j3: j2}: the count of j2 is added to that of j3; {j3: -j2}: subtracted; {}: none
    coupled: dict[str, str] | None = None
    pulses_per_deg: Positives | None = None


class PointEntry(Strict):
    """A named point in the jig frame."""

    x_mm: Number
    y_mm: Number
    z_mm: Number
    sigma_mm: Annotated[Number, Field(ge=0)] = 0.0


NamedPoint = Annotated[
    Annotated[PointEntry, Tag("<point>")] | Annotated[Literal["fit"], Tag("<fit>")], _by_type("<fit>", "<point>")
]


class SpacingEntry(Strict):
    """The distance of two named points."""

    model_config = ConfigDict(extra="forbid", allow_inf_nan=False, frozen=True, populate_by_name=True)
    start: str = Field(alias="from")
    end: str = Field(alias="to")
    mm: Positive
    sigma_mm: Positive = usual(Spacing, "sigma_mm")


class DeviceEntry(Strict):
    """What makes measurements of one kind; what is left out is as usual for the kind."""

    minutes: Positive | None = None
    sigma_mm: Positive | None = None
    sigma_deg: Positive | None = None
    range_mm: tuple[Positive, Positive] | None = None
    max_tilt_deg: Annotated[Number, Field(gt=0, le=180)] | None = None
    box_mm: tuple[tuple[Number, Number], tuple[Number, Number], tuple[Number, Number]] | None = None
    stand_mm: Vector | None = None  # this and the next four: of a tracker
    azimuth_deg: tuple[Degrees, Degrees] | None = None
    elevation_deg: tuple[Degrees, Degrees] | None = None
    target_axis: Vector | None = None
    acceptance_deg: Annotated[Number, Field(gt=0, le=180)] | None = None


class CellFile(Strict):
    """cell.yaml, the one file that a user writes."""

    robot: RobotSource
    jig: str | None = None
    base: Frame
    tool: Frame
    errors: list[str] | None = None  # this and the next three stand here where the robot file is not the user's own
    up: Vector | None = None
    payload: PayloadEntry | None = None
    temperature_c: Number | None = None
    joints: JointsEntry | None = None
    wire: WireEntry = WireEntry()
    touch: TouchEntry = TouchEntry()
    zone: ZoneEntry | None = None
    priors: PriorsEntry = PriorsEntry()
    controller: ControllerEntry = ControllerEntry()
    placements: dict[str, Frame] = {}
    tools: dict[str, Frame] = {}
    points: dict[str, NamedPoint] = {}
    spacings: list[SpacingEntry] = []
    measure: dict[Literal["touch", "position", "pose", "distance", "contact"], DeviceEntry] = {}
    serial: str = ""
    obstacles: list[ObstacleEntry] = []
    fixed: list[str] = []
    bounds: dict[str, tuple[Number, Number]] = {}


class EmbeddedCell(CellFile):
    """A cell in one document: robot and jig stand in it."""

    robot: RobotFile  # type: ignore[assignment]
    jig: JigFile | None = None  # type: ignore[assignment]
