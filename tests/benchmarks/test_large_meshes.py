"""20,000 touches on offer for an arm whose links have 50,000 triangles each: its published meshes, divided further.

Run with pytest tests/benchmarks/test_large_meshes.py --benchmark-only; the arm is looked for beside the checkout.
"""

import shutil
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from published import M10IA, PUBLISHED

from identify.model.cell import DEG, Cell, Priors
from identify.model.io.description import read_cell
from identify.model.meshes import read_mesh
from oed.candidates.candidates import candidates

TRIANGLES = 50_000
ON_OFFER = 20_000
PRIORS = Priors((3.0, 0.5 * DEG), (3.0, 1.0 * DEG), (1.0, 0.3 * DEG))
STL = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])


def divided(corners: np.ndarray, many: int) -> np.ndarray:
    """So many triangles of the same surface: those with the longest edges are halved, again and again."""
    while len(corners) < many:
        edge = np.linalg.norm(corners - np.roll(corners, -1, axis=1), axis=2)
        longest = np.argsort(-edge.max(axis=1))[: many - len(corners)]
        turned = (edge[longest].argmax(axis=1)[:, None] + np.arange(3)) % 3
        a, b, c = np.take_along_axis(corners[longest], turned[:, :, None], axis=1).transpose(1, 0, 2)
        halves = np.stack([a, (a + b) / 2, c], axis=1), np.stack([(a + b) / 2, b, c], axis=1)
        corners = np.concatenate([np.delete(corners, longest, axis=0), *halves])
    return corners


def cell_with_large_meshes(shared_data: Path, folder: Path) -> Cell:
    """The arm before its jig, each of its meshes divided into TRIANGLES triangles."""
    for part in ("robots/fanuc_m10ia_support", "jigs"):
        shutil.copytree(shared_data / part, folder / part)
    for file in (folder / "robots").rglob("*.stl"):
        vertices, triangles = read_mesh(file)
        out = np.zeros(TRIANGLES, STL)
        out["corners"] = divided(np.asarray(vertices, float)[triangles], TRIANGLES)
        file.write_bytes(bytes(80) + np.uint32(TRIANGLES).tobytes() + out.tobytes())
    path = folder / "cell.yaml"
    path.write_text(PUBLISHED.format(folder=folder, **(M10IA | {"out": 40, "long": 350, "bend": 22})))
    return replace(read_cell(path), priors=PRIORS)


@pytest.mark.benchmark(timer=time.process_time)
def test_an_arm_of_large_meshes_is_asked_for_20_000_touches(benchmark, shared_data, tmp_path):
    pytest.importorskip("coal")
    cell = cell_with_large_meshes(shared_data, tmp_path)
    meshes = [shape for shape in cell.robot.shapes if shape.kind == "mesh"]
    assert all(len(shape.mesh[1]) == TRIANGLES for shape in meshes)
    assert len(meshes) > 5

    touches = benchmark.pedantic(candidates, (cell, np.random.default_rng(0), ON_OFFER), rounds=1)

    assert len(touches) > ON_OFFER / 2  # those that robots surely meet
    assert benchmark.stats["max"] <= 12  # [s] of one core
