"""A six-axis arm as a URDF whose links are meshes in files of their own, written by hand."""

import struct
from itertools import product

import numpy as np

CORNERS = np.array(list(product((-0.5, 0.5), repeat=3)))
SQUARES = ((0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3))
TRIANGLES = np.array([t for a, b, c, d in SQUARES for t in ((a, b, c), (a, c, d))])

# name, joint before it (origin in metres, axis), box of the link (edges and middle in metres)
LINKS = (
    ("base_link", None, (0.18, 0.18, 0.16), (0, 0, 0.08)),
    ("turret", ((0, 0, 0), "0 0 1"), (0.14, 0.16, 0.2), (0, 0, 0.26)),
    ("upper", ((0, 0, 0.29), "0 1 0"), (0.1, 0.12, 0.3), (0, 0, 0.13)),
    ("elbow", ((0, 0, 0.27), "0 1 0"), (0.14, 0.1, 0.12), (0.04, 0, 0.07)),
    ("fore", ((0, 0, 0.07), "1 0 0"), (0.15, 0.07, 0.07), (0.2, 0, 0)),
    ("wrist", ((0.302, 0, 0), "0 1 0"), (0.06, 0.05, 0.06), (0, 0, 0)),
    ("hand", ((0.072, 0, 0), "1 0 0"), (0.01, 0.05, 0.05), (-0.005, 0, 0)),
)
LIMITS = ((-2.9, 2.9), (-1.9, 1.9), (-1.9, 1.2), (-2.8, 2.8), (-2.1, 2.1), (-4, 4))


def box(size, middle=(0, 0, 0)):
    """Vertices and triangles of a box."""
    return CORNERS * size + middle, TRIANGLES


def stl(vertices, triangles):
    """A binary STL."""
    facets = b"".join(
        struct.pack("<12fH", 0, 0, 0, *np.asarray(vertices)[list(t)].ravel().tolist(), 0) for t in triangles
    )
    return b"made by hand".ljust(80) + struct.pack("<I", len(triangles)) + facets


def text_stl(vertices, triangles):
    """An STL as text."""
    lines = ["solid any"]
    for t in triangles:
        corners = [f"vertex {x!r} {y!r} {z!r}" for x, y, z in np.asarray(vertices)[list(t)].tolist()]
        lines += ["facet normal 0 0 0", "outer loop", *corners, "endloop", "endfacet"]
    return "\n".join([*lines, "endsolid any\n"]).encode()


def obj(vertices, triangles):
    """An OBJ with texture and normal numbers, which are not asked for."""
    points = [f"v {x!r} {y!r} {z!r}" for x, y, z in np.asarray(vertices).tolist()]
    faces = ["f " + " ".join(f"{i + 1}/1/1" for i in t) for t in np.asarray(triangles).tolist()]
    return "\n".join(["# any", *points, "vt 0 0", "vn 0 0 1", *faces, ""]).encode()


def collision(geometry, origin=""):
    return f"<collision>{origin}<geometry>{geometry}</geometry></collision>"


def mesh(name, scale=None):
    return f'<mesh filename="{name}"' + (f' scale="{scale}"' if scale else "") + "/>"


def arm(shapes):
    """The text of the URDF; `shapes` are what its links have, by name."""
    links, joints = [], []
    for i, (name, joint, _, _) in enumerate(LINKS):
        links.append(f'<link name="{name}">{shapes.get(name, "")}</link>')
        if joint is not None:
            (x, y, z), axis = joint
            low, high = LIMITS[i - 1]
            joints.append(
                f'<joint name="a{i}" type="revolute"><parent link="{LINKS[i - 1][0]}"/><child link="{name}"/>'
                f'<origin xyz="{x} {y} {z}"/><axis xyz="{axis}"/>'
                f'<limit lower="{low}" upper="{high}" velocity="3"/></joint>'
            )
    links.append(f'<link name="flange">{shapes.get("flange", "")}</link>')
    joints.append(
        '<joint name="end" type="fixed"><parent link="hand"/><child link="flange"/>'
        '<origin rpy="0 1.5707963 0"/></joint>'
    )
    return '<robot name="meshed">\n' + "\n".join([*links, *joints]) + "\n</robot>\n"


def written(folder, **changed):
    """arm.urdf and the meshes of its links in a folder, some of the links with other shapes."""
    (folder / "meshes").mkdir(exist_ok=True)
    shapes = {}
    for name, _, size, middle in LINKS:
        (folder / "meshes" / f"{name}.stl").write_bytes(stl(*box(1000 * np.array(size), 1000 * np.array(middle))))
        shapes[name] = collision(mesh(f"package://arm_description/meshes/{name}.stl", "0.001 0.001 0.001"))
    path = folder / "arm.urdf"
    path.write_text(arm(shapes | changed))
    return path
