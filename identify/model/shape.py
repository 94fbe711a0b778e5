"""Solids that move with the links of a robot, as a URDF tells them: what the robot must not hit anything with."""

from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np
from jaxtyping import Float, Int

from identify.model.files import InputError, Mistake
from identify.model.meshes import read_mesh

WIDEST = 30_000.0  # [mm], a wider link was drawn in millimetres


@dataclass(frozen=True, eq=False)
class Shape:
    """A box, a cylinder, a sphere or a mesh; a mesh is read from its file when first asked for."""

    link: int  # 0 stands still, N carries the torch
    name: str  # of the URDF's link
    kind: str  # box, cylinder, sphere, mesh, or what else the URDF says, which is not read
    size: tuple[float, ...]  # [mm] edges of a box; radius and length of a cylinder; radius; mm per unit of a mesh
    pose: Float[np.ndarray, "4 4"]  # link_T_shape [mm]
    file: str = ""  # of a mesh, as the URDF names it
    path: Path | None = None  # where that was found

    @cached_property
    def mesh(self) -> tuple[Float[np.ndarray, "vertices 3"], Int[np.ndarray, "triangles 3"]]:
        """Vertices [mm] in the frame of the link, and triangles; raises InputError where the file is broken."""
        assert self.path is not None
        vertices, triangles = read_mesh(self.path)
        if (width := float(np.ptp(vertices * self.size, axis=0).max())) > WIDEST:
            text = f"the mesh of link '{self.name}' is {width / 1000:.0f} m wide: drawn in millimetres?"
            cure = 'a URDF is in metres; write <mesh ... scale="0.001 0.001 0.001"/>'
            raise InputError([Mistake(str(self.path), 0, f"{text} {cure}")])
        return (vertices * self.size) @ self.pose[:3, :3].T + self.pose[:3, 3], triangles
