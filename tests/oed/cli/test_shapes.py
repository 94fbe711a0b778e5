"""A robot with meshes as a user brings it: from the URDF to a plan, and what is said where meshes cannot be judged."""

import json
import shutil
from hashlib import sha256

import pytest
from meshed import LINKS, arm, collision, mesh, written

from identify.model import base_placement
from oed.cli import main

SAYS = "pip install 'touchcal[collision]' (Linux, macOS)"


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A folder made from a URDF whose meshes lie elsewhere."""
    path = tmp_path_factory.mktemp("meshed")
    (path / "cad").mkdir()
    with pytest.raises(SystemExit, match="0"):
        main(["init", str(path / "mine"), "--robot", str(written(path / "cad"))])
    return path / "mine"


@pytest.fixture
def project(folder, tmp_path, monkeypatch):
    """A copy of that folder."""
    monkeypatch.chdir(shutil.copytree(folder, tmp_path / "mine"))
    return tmp_path / "mine"


def test_a_folder_holds_the_meshes_of_its_robot(project, touchcal):
    pytest.importorskip("coal")
    assert {path.stem for path in (project / "meshes").iterdir()} == {name for name, *_ in LINKS}

    code, out, _ = touchcal("check")

    assert code == 0
    assert "arm: 7 collision shapes judged as solids, of links base_link, turret, upper, elbow" in out
    assert "collision:" not in out


def test_meshes_of_one_name_in_different_folders_are_kept_apart(tmp_path, touchcal, monkeypatch):
    monkeypatch.setattr(base_placement, "TRIES", 1)
    path, shapes = written(tmp_path), {}
    for name in ("upper", "fore"):
        (tmp_path / name).mkdir()
        (tmp_path / "meshes" / f"{name}.stl").rename(tmp_path / name / "part.stl")
        shapes[name] = collision(mesh(f"{name}/part.stl", "0.001 0.001 0.001"))
    path.write_text(arm(shapes))

    touchcal("init", tmp_path / "mine", "--urdf", path)

    copied = [p.read_bytes() for p in (tmp_path / "mine" / "meshes").iterdir()]
    assert sorted(copied) == sorted((tmp_path / name / "part.stl").read_bytes() for name in shapes)
    code, out, _ = touchcal("check", "--cell", tmp_path / "mine" / "cell.yaml")
    assert (code, "of links upper, fore" in out) == (0, True)


def test_a_mesh_that_is_missing_is_told_and_the_others_are_judged(project, touchcal):
    (project / "meshes" / "fore.stl").unlink()

    code, out, _ = touchcal("check")

    assert code == 0
    assert "arm: 6 collision shapes" in out
    assert "collision: a mesh is not found beside the URDF or in the folders above it, 'meshes/fore.stl'" in out
    assert "nothing keeps link 'fore' clear; put the files where the URDF says" in out


def test_a_shape_of_another_kind_is_told(project, touchcal):
    (project / "meshes" / "fore.dae").write_text("<COLLADA/>")
    urdf = project / "arm.urdf"
    urdf.write_text(urdf.read_text().replace("fore.stl", "fore.dae"))

    code, out, _ = touchcal("check")

    assert code == 0
    assert "collision: 'meshes/fore.dae' of link 'fore' is of a kind that is not read" in out


def test_a_broken_mesh_is_one_sentence(project, touchcal):
    (project / "meshes" / "fore.stl").write_bytes(b"solid nothing")

    for command in (("check",), ("plan", "-n", "30")):
        code, _, err = touchcal(*command)
        assert code == 2
        assert "fore.stl: the mesh has no triangles; export it again from CAD" in err
        assert "Traceback" not in err


def test_without_the_extra_capsules_are_judged_and_one_sentence_says_so(project, touchcal, monkeypatch):
    for module in ("probe.motion.bodies", "probe.motion.clearance"):
        monkeypatch.setattr(f"{module}.exact_meshes", lambda: False)

    code, out, _ = touchcal("check")

    assert code == 0
    assert "arm: 7 collision shapes judged as capsules around them" in out
    assert out.count(SAYS) == 1


@pytest.mark.usefixtures("few_candidates")
def test_a_plan_says_what_is_not_kept_clear(project, touchcal):
    (project / "meshes" / "fore.stl").unlink()

    code, out, _ = touchcal("plan", "-n", "30", "--strategy", "random", "--json")

    assert code == 0
    told = json.loads(out)
    assert told["touches"] == 30
    inputs = json.loads((project / "plan.json").read_text())["inputs"]
    assert inputs["meshes/upper.stl"] == sha256((project / "meshes" / "upper.stl").read_bytes()).hexdigest()
    assert sum("nothing keeps link 'fore' clear" in note for note in told["notes"]) == 1
