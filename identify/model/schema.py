"""The YAML files a user writes, validated: every mistake at once, with file and line."""

from pathlib import Path
from typing import Annotated, Any, Literal, TypeVar

from pydantic import BaseModel, ConfigDict, Discriminator, Field, Tag, ValidationError
from ruamel.yaml import YAML
from ruamel.yaml.comments import CommentedMap, CommentedSeq
from ruamel.yaml.error import MarkedYAMLError
from ruamel.yaml.reader import ReaderError

from identify.model.files import InputError, Mistake, nearest, read_text

Number = Annotated[float, Field(strict=True)]  # not a text that reads like one, nor true or false
Positive = Annotated[Number, Field(gt=0)]
Vector = tuple[Number, Number, Number]


class Strict(BaseModel):
    """Unknown keys and numbers that are none are mistakes."""

    model_config = ConfigDict(extra="forbid", allow_inf_nan=False, frozen=True)


Model = TypeVar("Model", bound=Strict)


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
    mass_kg: Annotated[Number, Field(ge=0)] = 0.0
    centre_mm: Vector = (0.0, 0.0, 0.0)


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
    up: Vector = (0.0, 0.0, 1.0)
    payload: PayloadEntry | None = None
    temperature_c: Number = 20.0


class FaceEntry(Strict):
    """One face of jig.yaml."""

    name: Annotated[str, Field(min_length=1)]
    origin_mm: Vector
    u_mm: Vector
    v_mm: Vector
    tolerance_mm: Annotated[Number, Field(ge=0)] = 0.0


class BoxEntry(Strict):
    """One solid block of jig.yaml, along the axes of the jig frame."""

    lower_mm: Vector
    upper_mm: Vector


class JigFile(Strict):
    """jig.yaml."""

    name: str
    source: str = ""
    faces: Annotated[list[FaceEntry], Field(min_length=1)]
    boxes: list[BoxEntry] = []


class WireEntry(Strict):
    """The end of the wire."""

    radius_mm: Annotated[Number, Field(ge=0)] = 0.6
    shape: Literal["point", "ball", "flat"] = "flat"


class TouchEntry(Strict):
    """How touches are made."""

    sigma_mm: Positive = 0.05
    approach_mm: Positive = 25.0
    travel_mm: Positive = 60.0
    speed_mm_s: Positive = 5.0
    max_tilt_deg: Annotated[Number, Field(gt=0, le=90)] = 50.0


class ZoneEntry(Strict):
    """Where accuracy counts, in the jig frame."""

    box_mm: tuple[tuple[Number, Number], tuple[Number, Number], tuple[Number, Number]]
    max_tilt_deg: Annotated[Number, Field(gt=0, le=180)] = 60.0


class PriorsEntry(Strict):
    """Manufacturing and set-up tolerances, 1 sigma."""

    base_mm: Positive = 10.0
    base_deg: Positive = 2.0
    tool_mm: Positive = 10.0
    tool_deg: Positive = 2.0
    length_mm: Positive = 3.0
    angle_deg: Positive = 1.0
    errors: dict[str, Positive] = {}


class ControllerEntry(Strict):
    """The robot controller at the other end of the line."""

    port: str = "sim"
    protocol: str = "line"
    baud: Annotated[int, Field(gt=0)] = 115200
    axis_unit_deg: Positive = 1.0


class UrdfEntry(Strict):
    """A robot described by a URDF: the chain between two of its links."""

    urdf: str
    base: str
    flange: str


def _by_type(text: str, mapping: str) -> Discriminator:
    return Discriminator(lambda value: text if isinstance(value, str) else mapping)


Frame = Annotated[
    Annotated[PoseEntry, Tag("<frame>")] | Annotated[Literal["fit"], Tag("<fit>")], _by_type("<fit>", "<frame>")
]
RobotSource = Annotated[
    Annotated[str, Tag("<file>")] | Annotated[UrdfEntry, Tag("<urdf>")], _by_type("<file>", "<urdf>")
]


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
    wire: WireEntry = WireEntry()
    touch: TouchEntry = TouchEntry()
    zone: ZoneEntry | None = None
    priors: PriorsEntry = PriorsEntry()
    controller: ControllerEntry = ControllerEntry()
    fixed: list[str] = []
    bounds: dict[str, tuple[Number, Number]] = {}


class EmbeddedCell(CellFile):
    """A cell in one document: robot and jig stand in it."""

    robot: RobotFile  # type: ignore[assignment]
    jig: JigFile | None = None  # type: ignore[assignment]


class Document:
    """A YAML file parsed with the place of every key."""

    def __init__(self, path: Path) -> None:
        self.path = path
        text = read_text(path)
        try:
            self.data: Any = YAML().load(text)
        except MarkedYAMLError as error:
            line = error.problem_mark.line + 1 if error.problem_mark else 0
            raise InputError([Mistake(str(path), line, f"not valid YAML: {error.problem}")]) from None
        except ReaderError as error:
            line = text.count("\n", 0, error.position) + 1
            raise InputError([Mistake(str(path), line, f"not valid YAML: {error.reason}")]) from None
        except (ValueError, RecursionError) as error:  # a date of month 13, brackets a thousand deep
            raise InputError([Mistake(str(path), 0, f"not valid YAML: {error}")]) from None

    def line(self, location: tuple[int | str, ...]) -> int:
        """The line of a key, or of the nearest thing around it that has one."""
        node, line = self.data, 1
        for key in location:
            if isinstance(node, CommentedMap) and key in node:
                line = node.lc.key(key)[0] + 1
            elif isinstance(node, CommentedSeq) and isinstance(key, int) and key < len(node):
                line = node.lc.item(key)[0] + 1
            else:
                break
            node = node[key]
        return line

    def wrong(self, text: str, *location: int | str) -> Mistake:
        """A mistake at a key of this file."""
        return Mistake(str(self.path), self.line(location), text)

    def get(self, key: str) -> Any:
        """What stands at a key, unchecked; None where nothing does."""
        return self.data.get(key) if isinstance(self.data, dict) else None

    def items(self, key: str) -> list[Any]:
        """The items of a list, unchecked; none where there is no list."""
        found = self.get(key)
        return found if isinstance(found, list) else []


def load(path: Path, model: type[Model]) -> tuple[Model, Document]:
    """Read and validate a YAML file; raises InputError with every mistake."""
    document = Document(path)
    file, mistakes = validated(document, model)
    if file is None:
        raise InputError(mistakes)
    return file, document


def validated(document: Document, model: type[Model]) -> tuple[Model | None, list[Mistake]]:
    """What a file holds, or what is wrong with its form."""
    if not isinstance(document.data, dict):
        keys = ", ".join(list(model.model_fields)[:3])
        return None, [Mistake(str(document.path), 1, f"expected keys such as {keys}")]
    try:
        return model.model_validate(document.data), []
    except ValidationError as error:
        return None, [_mistake(document, model, e) for e in error.errors()]


def usable(raw: Any, model: type[Model]) -> Model | None:
    """What can be read of an entry without the keys that are wrong; None where nothing can."""
    for _ in range(2):
        try:
            return model.model_validate(raw)
        except ValidationError as error:
            wrong = {e["loc"][0] for e in error.errors() if e["loc"]}
            raw = {key: value for key, value in raw.items() if key not in wrong} if isinstance(raw, dict) else None
    return None


def entries(document: Document, key: str, model: type[Model]) -> list[tuple[int, Model]]:
    """The items of a list that can be read, with their places."""
    found = [(i, usable(item, model)) for i, item in enumerate(document.items(key))]
    return [(i, entry) for i, entry in found if entry is not None]


def _mistake(document: Document, model: type[Strict], error: Any) -> Mistake:
    """One of pydantic's findings as a sentence with its line."""
    location = tuple(part for part in error["loc"] if not str(part).startswith("<"))  # tags of the unions
    where = ".".join(str(part) for part in location)
    if error["type"] == "extra_forbidden":
        known = _known_keys(model, location[:-1])
        return document.wrong(
            f"unknown key '{where}'{nearest(str(location[-1]), known)}; known: {', '.join(known)}", *location
        )
    if error["type"] == "missing":
        return document.wrong(f"key '{where}' is missing", *location)
    return document.wrong(f"{where} is {error['input']!r}: {error['msg'][0].lower()}{error['msg'][1:]}", *location)


def _known_keys(model: type[Strict], location: tuple[int | str, ...]) -> list[str]:
    """The keys allowed at a place of a file."""
    found: Any = model
    for part in location:
        if isinstance(part, str):
            found = next(iter(_models_in(found.model_fields[part].annotation)), None) if found else None
    return list(found.model_fields) if found else []


def _models_in(annotation: Any) -> list[type[Strict]]:
    if isinstance(annotation, type) and issubclass(annotation, Strict):
        return [annotation]
    return [m for argument in getattr(annotation, "__args__", ()) for m in _models_in(argument)]
