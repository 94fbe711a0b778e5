"""Frames and tools in backups of controllers: texts in the form of public backups, poses by SciPy."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from identify.model.files import InputError
from identify.model.io.description import library, read_cell
from identify.programs.backups import is_backup, read_backup
from identify.programs.setup import read_setups

# The form of a backup of a controller V9.40 as a public reader of such files quotes it; numbers below 1 have no zero.
SYSFRAME = """\
[*SYSTEM*]$MNUFRAME  Storage: SHADOW  Access: RW  : ARRAY[1,9] OF POSITION
    [1,1] =
  Group: 1   Config: N D B, 0, 0, 0
  X:     0.000   Y:     0.000   Z:     0.000
  W:     0.000   P:     0.000   R:     0.000
    [1,2] =
  Group: 1   Config: N D B, 0, 0, 0
  X:   800.500   Y:  -120.250   Z:     -.750
  W:    10.000   P:     -.649   R:    90.000
[*SYSTEM*]$MNUFRAMENUM  Storage: SHADOW  Access: RW  : ARRAY[1] OF BYTE
  [1] = 2
[*SYSTEM*]$MNUTOOL  Storage: SHADOW  Access: RW  : ARRAY[1,10] OF POSITION
    [1,1] =
  Group: 1   Config: N D B, 0, 0, 0
  X:     0.000   Y:     0.000   Z:   410.000
  W:     0.000   P:   -18.000   R:     0.000
[*SYSTEM*]$MNUTOOLNUM  Storage: SHADOW  Access: RW  : ARRAY[1] OF BYTE
  [1] = 1
"""
CONFIG = """\
&ACCESS RV
DEFDAT  $CONFIG PUBLIC
BASE_DATA[1]={X 800.5,Y -120.25,Z -0.75,A 90.0,B -0.649,C 10.0}
BASE_DATA[2]={X 0.0,Y 0.0,Z 0.0,A 0.0,B 0.0,C 0.0}
BASE_NAME[1,]="JIG"
TOOL_DATA[1]={X 0.0,Y 0.0,Z 410.0,A 0.0,B -18.0,C 0.0}
TOOL_TYPE[1]=#BASE
LOAD_DATA[1]={M 5.5,CM {X 1.0,Y 2.0,Z 3.0,A 0.0,B 0.0,C 0.0},J {X 0.0,Y 0.0,Z 0.0}}
ENDDAT
"""
SYS = """\
MODULE user (SYSMODULE)
  PERS tooldata tTorch:=[TRUE,[[0,0,410],[0.987688341,0,-0.156434465,0]],[2.5,[0,0,100],[1,0,0,0],0,0,0]];
  PERS tooldata tFixed := [ FALSE, [ [1, 2, 3], [1, 0, 0, 0] ],
    [2.5,[0,0,100],[1,0,0,0],0,0,0]];
  PERS wobjdata wJig:=[FALSE,TRUE,"",[[800.5,-120.25,-0.75],[0.707106781,0,0,0.707106781]],
    [[10,0,0],[1,0,0,0]]];
  !PERS wobjdata wJig:=[FALSE,TRUE,"",[[1,2,3],[1,0,0,0]],[[0,0,0],[1,0,0,0]]]; ! as it stood before
  CONST string sHint:="! Check"; PERS tooldata tHeld:=[FALSE,[[1,2,3],[1,0,0,0]],[1,[0,0,1],[1,0,0,0],0,0,0]]; !PERS
  TASK PERS wobjdata wMoved:=[FALSE,FALSE,"STN1",[[1,2,3],[1,0,0,0]],[[0,0,0],[1,0,0,0]]];
ENDMODULE
"""
UFRAME = """\
//UFRAME 1
///NAME JIG
///TOOL 0
///GROUP 1,0
////BUSER 800.500,-120.250,-0.750,10.0000,-0.6490,90.0000
////ORG 1.000,2.000,3.000,4.0000,5.0000,6.0000
//UFRAME 2
///NAME
////BUSER 0.000,0.000,0.000,0.0000,0.0000,0.0000
"""
TOOL = """\
//TOOL 0
///NAME TORCH
0.000,0.000,410.000,0.0000,-18.0000,0.0000
0.000,0.000,80.000
2.500
//TOOL 1
///NAME
0.000,0.000,0.000,0.0000,0.0000,0.0000
"""


def pose(x, y, z, rz, ry, rx):
    T = np.eye(4)
    T[:3, 3], T[:3, :3] = (x, y, z), Rotation.from_euler("ZYX", [rz, ry, rx], degrees=True).as_matrix()
    return T


JIG, TORCH = pose(800.5, -120.25, -0.75, 90, -0.649, 10), pose(0, 0, 410, 0, -18, 0)
SQUARE = pose(800.5, -110.25, -0.75, 90, 0, 0)  # a work object: its object frame lies 10 mm along x of its user frame


@pytest.mark.parametrize("end", ["\n", "\r\n"])
@pytest.mark.parametrize(
    ("files", "frames", "tools"),
    [
        ({"sysframe.va": SYSFRAME}, {"2": JIG}, {"1": TORCH}),
        ({"$config.dat": CONFIG}, {"1": JIG}, {"1": TORCH}),
        ({"SYS.MOD": SYS}, {"wJig": SQUARE}, {"tTorch": TORCH}),
        ({"USER.SYS": SYS}, {"wJig": SQUARE}, {"tTorch": TORCH}),
        ({"UFRAME.CND": UFRAME, "TOOL.CND": TOOL}, {"1": JIG}, {"0": TORCH}),
    ],
    ids=lambda value: next(iter(value)) if isinstance(value, dict) else repr(value),
)
def test_frames_and_tools_that_somebody_has_set_are_read(files, frames, tools, end, tmp_path):
    for name, text in files.items():
        (tmp_path / name).write_bytes(text.replace("\n", end).encode("latin-1"))

    setup = read_setups([tmp_path / name for name in files], read_cell(library("cells")["arc-welder"]).robot)

    for read, expected in ((setup.frames, frames), (setup.tools, tools)):
        assert read.keys() == expected.keys()
        for name, T in expected.items():
            np.testing.assert_allclose(read[name], T, atol=1e-5, err_msg=name)


def test_a_table_of_the_user_wins_over_a_backup(tmp_path):
    (tmp_path / "$config.dat").write_text(CONFIG)
    (tmp_path / "frames.yaml").write_text("frames: {1: {x_mm: 1}, 7: {x_mm: 7}}\n")

    for order in (("frames.yaml", "$config.dat"), ("$config.dat", "frames.yaml")):
        robot = read_cell(library("cells")["arc-welder"]).robot
        setup = read_setups([tmp_path / name for name in order], robot)
        assert setup.frames["1"][0, 3] == 1
        assert setup.frames.keys() == {"1", "7"}
        np.testing.assert_allclose(setup.tools["1"], TORCH, atol=1e-9)


@pytest.mark.parametrize(("name", "text"), [("posreg.va", "[*POSREG*]$POSREG\n"), ("a.CND", ""), ("b.dat", "X=1\n")])
def test_a_file_without_frames_is_asked_about(name, text, tmp_path):
    (tmp_path / name).write_text(text)

    assert is_backup(tmp_path / name)
    with pytest.raises(InputError, match=f"{name}.*holds no frame and no tool that is set"):
        read_backup(tmp_path / name)
