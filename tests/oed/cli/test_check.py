"""`touchcal check`: what it says of a cell and of a pendant, and what it writes."""

import numpy as np
import pytest

from identify.model.frames import euler, transform
from identify.model.io.description import read_cell


def test_check_says_that_an_empty_pendant_tells_too_little(tmp_path, touchcal):
    touchcal("init", tmp_path)

    code, _, err = touchcal("check", "--cell", tmp_path / "cell.yaml", "--pendant", tmp_path / "pendant.csv")

    assert code == 2
    assert "0 poses tell too little" in err


def read_off(folder, touchcal, counts):
    """A cell and poses read off a pendant that shows `counts` times the joints of the model."""
    assert touchcal("init", folder)[0] == 0
    cell, pendant = folder / "cell.yaml", folder / "pendant.csv"
    described = read_cell(cell)
    q = np.random.default_rng(5).uniform(-0.8, 0.8, (6, 6))
    p, R = described.kinematics.flange(q, described.theta)
    tool = transform(described.tool)
    rz, ry, rx = np.degrees(euler(R @ tool[:3, :3]).T)
    rows = np.column_stack([np.degrees(q) @ counts.T, p + R @ tool[:3, 3], rx, ry, rz]).round(3)
    with pendant.open("a") as file:
        file.writelines(f"p{i}," + ",".join(map(str, row)) + "\n" for i, row in enumerate(rows.tolist()))
    return cell, pendant


def test_check_writes_that_no_joint_is_counted_with_another_where_model_and_pendant_agree(tmp_path, touchcal):
    cell, pendant = read_off(tmp_path, touchcal, np.eye(6))
    assert not read_cell(cell).robot.counting.stated

    code, said, _ = touchcal("check", "--cell", cell, "--pendant", pendant, "--fix")

    assert code == 0
    assert "wrote joints: {coupled: {}} into" in said
    assert read_cell(cell).robot.counting.stated
    assert not read_cell(cell).robot.counting.differs


def test_check_writes_how_the_controller_counts_and_keeps_the_comments(tmp_path, touchcal):
    cell, pendant = read_off(
        tmp_path,
        touchcal,
        np.array([[1, 0, 0, 0, 0, 0], [0, 1, 0, 0, 0, 0], [0, -1, 1, 0, 0, 0], *np.diag([0, 0, 0, 1, -1, 1])[3:]]),
    )  # joint 3 against the horizontal, as FANUC shows it
    before = cell.read_text()

    proposed = touchcal("check", "--cell", cell, "--pendant", pendant)
    written = touchcal("check", "--cell", cell, "--pendant", pendant, "--fix")

    line = "joints: {sign: {j5: -1}, coupled: {j3: j2}}"
    assert proposed[0] == 1
    assert f"  {line}\n" in proposed[1]
    assert written[0] == 0
    assert cell.read_text() == before + line + "\n"
    assert "pendant: agrees" in written[1]


@pytest.mark.parametrize(
    ("x", "y", "why"), [(340, 3000, "reaches no pose of the weld zone"), (340, 3000, "out of reach"), (200, 150, "jig")]
)
def test_a_base_out_of_reach_or_inside_the_jig_is_said_and_refused_with_the_reason(tmp_path, touchcal, x, y, why):
    touchcal("init", tmp_path)
    cell = tmp_path / "cell.yaml"
    cell.write_text(
        cell.read_text().replace("base: {x_mm: 340, y_mm: 740, z_mm: 350", f"base: {{x_mm: {x}, y_mm: {y}, z_mm: 0")
    )
    assert read_cell(cell).base[1] == y

    code, said, _ = touchcal("check", "--cell", cell)

    assert (code, "cell is valid" in said) == (2, False)
    assert why in said.split("this cell can do nothing: ", 1)[1]
    assert "this cell can do nothing" in (tmp_path / "cell.html").read_text()


def test_the_command_to_go_on_with_names_the_files_from_where_the_user_stands(tmp_path, touchcal):
    touchcal("init", tmp_path)

    code, said, _ = touchcal("check", "--cell", tmp_path / "cell.yaml")

    command = said.split("touchcal check ")[1].splitlines()[0].split()
    assert code == 0
    assert command == ["--cell", str(tmp_path / "cell.yaml"), "--pendant", str(tmp_path / "pendant.csv")]
