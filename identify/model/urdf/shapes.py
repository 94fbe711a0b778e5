"""The collision shapes of a URDF, on the links of the chain that was read from it."""

import xml.etree.ElementTree as ET
from collections.abc import Callable, Sequence
from pathlib import Path
from urllib.parse import unquote, urlparse

import numpy as np
from jaxtyping import Float

from identify.model.frames import inverse
from identify.model.shape import Shape
from identify.model.urdf.document import METRE, Urdf, end, origin

SIZES: dict[str, Callable[[Urdf, ET.Element, str], list[np.ndarray]]] = {
    "box": lambda urdf, g, what: [urdf.vector(g, "size", [0.0] * 3, what)],
    "cylinder": lambda urdf, g, what: [urdf.vector(g, key, [0.0], what) for key in ("radius", "length")],
    "sphere": lambda urdf, g, what: [urdf.vector(g, "radius", [0.0], what)],
    "mesh": lambda urdf, g, what: [urdf.vector(g, "scale", [1.0] * 3, what)],
}


def collision_shapes(
    urdf: Urdf, base: str, moving: Sequence[ET.Element], frames: Sequence[Float[np.ndarray, "4 4"]]
) -> tuple[Shape, ...]:
    """Shapes of the links between `base` and the last of the `moving` joints, and of all that is fixed to them.

    `frames` are the links' frames while every joint reads zero, that before the first joint first.
    """
    links = {link.get("name", ""): link for link in urdf.root.iterfind("link") if link.find("collision") is not None}
    if not links:
        return ()
    out = list[Shape]()
    for name, (number, base_T_link) in _places(urdf, base, moving).items():
        for element in links[name].iterfind("collision") if name in links else ():
            what = f"collision of link '{name}'"
            pose = inverse(frames[number]) @ base_T_link @ origin(urdf, element, what)
            out.append(_shape(urdf, element, what, number, name, pose))
    return tuple(sorted(out, key=lambda shape: shape.link))


def _places(urdf: Urdf, base: str, moving: Sequence[ET.Element]) -> dict[str, tuple[int, Float[np.ndarray, "4 4"]]]:
    """Link of the chain that each link of the URDF moves with, and where it is at zero; what moves besides is left."""
    joints = [(end(j, "parent"), end(j, "child"), j) for j in urdf.root.iterfind("joint")]
    places, going = {base: (0, np.eye(4))}, [base]
    while going:
        here = going.pop()
        number, T = places[here]
        for parent, child, joint in joints:
            fixed = joint.get("type") == "fixed"
            there = child if parent == here else parent
            if here not in (parent, child) or there in places or not (fixed or joint in moving):
                continue
            step = origin(urdf, joint, f"joint '{joint.get('name', '')}'")
            places[there] = (number + (not fixed), T @ (step if parent == here else inverse(step)))
            going.append(there)
    return places


def _shape(urdf: Urdf, element: ET.Element, what: str, number: int, name: str, pose: Float[np.ndarray, "4 4"]) -> Shape:
    geometry = element.find("geometry")
    solid = None if geometry is None else next(iter(geometry), None)
    if solid is None:
        urdf.wrong(element, f"{what} has no geometry; write a box, a cylinder, a sphere or a mesh")
        return Shape(number, name, "nothing", (), pose)
    numbers = np.concatenate([np.zeros(0), *(SIZES[solid.tag](urdf, solid, what) if solid.tag in SIZES else [])])
    if (numbers <= 0).any() and not (solid.tag == "mesh" and (numbers != 0).all()):
        urdf.wrong(solid, f"{what}: a {solid.tag} of size 0 or less")
    file = solid.get("filename", "") if solid.tag == "mesh" else ""
    path = located(file, Path(urdf.file)) if file else None
    return Shape(number, name, solid.tag, tuple((numbers * METRE).tolist()), pose, file, path)


def located(file: str, urdf: Path) -> Path | None:
    """Where the file of a mesh is: package://NAME/... in a folder NAME above the URDF, or in one beside such."""
    address = urlparse(file)
    name = unquote(address.path)
    beside = urdf.absolute().parent
    if address.scheme == "package":
        above = [beside, *beside.parents]
        tried = [folder / address.netloc / name.lstrip("/") for folder in above]
        tried += [folder / name.lstrip("/") for folder in above if folder.name == address.netloc or folder == beside]
    elif address.scheme == "file":
        tried = [Path(name)]
    else:
        tried = [beside / file]
    return next((path for path in tried if path.is_file()), None)
