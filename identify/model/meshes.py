"""Triangles from STL (binary or text) and OBJ files."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
from jaxtyping import Float, Int

from identify.model.files import InputError, Mistake, read_bytes

Mesh = tuple[Float[np.ndarray, "vertices 3"], Int[np.ndarray, "triangles 3"]]
HEADER, FACET = 84, 50  # bytes of a binary STL
CURE = "export it again from CAD"


def read_mesh(path: Path) -> Mesh:
    """Vertices in the units of the file, each once, and triangles of them; raises InputError where there are none."""
    try:
        vertices, triangles = READERS[path.suffix.lower()](read_bytes(path))
    except (ValueError, IndexError) as error:
        raise InputError([Mistake(str(path), 0, f"not a mesh that can be read: {error}; {CURE}")]) from None
    if not len(triangles):
        raise InputError([Mistake(str(path), 0, f"the mesh has no triangles; {CURE}")])
    if not np.isfinite(vertices).all():
        raise InputError([Mistake(str(path), 0, f"the mesh has vertices that are not finite; {CURE}")])
    once, place = np.unique(vertices, axis=0, return_inverse=True)
    return once, place.ravel()[triangles]


def _stl(content: bytes) -> Mesh:
    """A file is binary where its length fits the number of facets that it states: some binary ones begin with solid."""
    count = int.from_bytes(content[80:HEADER], "little")
    if len(content) == HEADER + FACET * count:
        facets = np.frombuffer(content, np.dtype([("numbers", "<f4", (4, 3)), ("rest", "<u2")]), offset=HEADER)
        corners = facets["numbers"][:, 1:].reshape(-1, 3).astype(float)
    elif content[:5].lower() == b"solid" and b"\0" not in content:
        words = content.decode("utf-8", "replace").split()
        at = np.array([i for i, word in enumerate(words) if word == "vertex"], dtype=int)
        if len(at) % 3 or words.count("endfacet") * 3 != len(at):
            raise ValueError(f"text STL with {len(at)} vertices in {words.count('endfacet')} whole facets")
        corners = np.array([[float(word) for word in words[i + 1 : i + 4]] for i in at.tolist()]).reshape(-1, 3)
    else:
        raise ValueError(f"{len(content)} bytes, expected {HEADER + FACET * count} of an STL with {count} facets")
    return corners, np.arange(len(corners)).reshape(-1, 3)


def _obj(content: bytes) -> Mesh:
    vertices, triangles = list[list[float]](), list[tuple[int, int, int]]()
    for number, line in enumerate(content.decode("utf-8", "replace").splitlines(), 1):
        kind, *words = line.split() or [""]
        if kind == "v":
            vertices.append([float(word) for word in words[:3]])
        elif kind == "f":
            corner = [_place(word, len(vertices), number) for word in words]
            triangles += [(corner[0], corner[k], corner[k + 1]) for k in range(1, len(corner) - 1)]
    return np.array(vertices, dtype=float).reshape(-1, 3), np.array(triangles, dtype=int).reshape(-1, 3)


def _place(word: str, count: int, line: int) -> int:
    """A vertex by its number: from 1, or backwards from the last so far."""
    number = int(word.split("/")[0])
    place = number - 1 if number > 0 else count + number
    if not 0 <= place < count:
        raise ValueError(f"line {line} names vertex {number} of {count}")
    return place


READERS: dict[str, Callable[[bytes], Mesh]] = {".stl": _stl, ".obj": _obj}
