"""The README is run: every shell block works, every cell file is read, every output shown is what comes out."""

import re
import shutil

import numpy as np
import pytest
from readme import README, REAL_ROBOT, block, blocks, run
from ruamel.yaml import YAML

from identify.model.io.description import read_cell
from identify.model.io.schema import ControllerEntry
from probe.controllers import PROTOCOLS
from probe.line.controller import CODES

pytestmark = pytest.mark.xdist_group("demo")  # one demo for all of them, and for the tests of the demo
USE = "Use the result"
SEAM = """/PROG SEAM
/MN
   1:L P[1] 100mm/sec FINE ;
/POS
P[1]{
   GP1:
	UF : 0, UT : 1,		CONFIG : 'N U T, 0, 0, 0',
	X =  590.000 mm,	Y = -220.000 mm,	Z = -140.000 mm,
	W =  180.000 deg,	P =    0.000 deg,	R =    0.000 deg
};
/END
"""
NUMBER = re.compile(r"[-+]?\d+(?:\.\d+)?")


def assert_shown(shown, said):
    """The same words, and numbers that differ by no more than machines do."""
    assert NUMBER.sub("#", shown).split() == NUMBER.sub("#", said).split()
    a, b = ([float(x) for x in NUMBER.findall(text)] for text in (shown, said))
    np.testing.assert_allclose(a, b, rtol=0.3, atol=0.02)


def same_part(shown, said):
    """What is shown, and as many lines of what was said, from the last that begins as what is shown does."""
    lines, begin = said.splitlines(), shown.splitlines()[0]
    first = max(i for i, line in enumerate(lines) if NUMBER.sub("#", line) == NUMBER.sub("#", begin))
    return shown, "\n".join(lines[first : first + len(shown.splitlines())])


def test_the_two_commands_install_alike_from_the_lock_and_the_second_runs_the_tests():
    first, second = (b.text for b in blocks() if b.language == "sh" and b.heading.startswith("Run the"))
    install, start = first.rsplit("&&", 1)
    with_tests = install.replace("-r requirements.lock", "-r requirements.lock -r tests/requirements.lock")

    assert second.startswith(with_tests)
    assert with_tests != install
    assert start.strip() == ".venv/bin/touchcal demo -o demo"
    assert "pytest" in second.removeprefix(with_tests)


def test_the_demo_prints_what_the_readme_shows(demo):
    assert_shown(block("output: demo").text, demo.said)


@pytest.mark.parametrize("number", range(sum(b.heading == "The loop" and b.language == "sh" for b in blocks())))
def test_the_blocks_of_the_loop_run_in_a_copy_of_the_demo(number, demo, tmp_path):
    shutil.copytree(demo.folder, tmp_path / "project")
    loop = [b.text for b in blocks() if b.heading == "The loop" and b.language == "sh"]

    said = run(loop[number], tmp_path / "project")

    if shown := {0: "output: check", 1: "output: plan", 2: "output: verify"}.get(number):
        assert_shown(*same_part(block(shown).text, said))


def test_the_pictures_of_the_readme_are_there():
    names = re.findall(r"!\[[^\]]+\]\(([^)]+)\)", README.read_text(encoding="utf-8"))

    assert names
    assert all((README.parent / name).is_file() for name in names)


def test_the_virtual_cell_is_touched_as_the_readme_shows(demo, tmp_path):
    shutil.copytree(demo.folder, tmp_path / "project")
    command = next(b.text for b in blocks() if b.heading == "Try it without a robot")

    said = run(command, tmp_path / "project")

    assert "12 approaches visited" in said
    assert "of 12 touches made" in said
    assert (tmp_path / "project" / "more-touches-corrected.csv").exists()


def test_the_controller_section_names_what_there_is():
    (entry,) = [b.text for b in blocks() if b.heading == "The controller" and b.language == "yaml"]
    section = README.read_text(encoding="utf-8").partition("## The controller")[2].partition("## Use")[0]
    protocol = (README.parent / re.search(r"\[TOUCH/1\]\(([^)]+)\)", section)[1]).read_text(encoding="utf-8")

    assert set(YAML().load(entry)["controller"]) <= set(ControllerEntry.model_fields)
    assert all(f"`protocol: {protocol}`" in section for protocol in PROTOCOLS)
    assert all(code in protocol for code in CODES if code not in ("ROBOT", "LOST"))


@pytest.fixture(scope="module")
def project(demo, tmp_path_factory):
    """A copy of the demo with a program, which the section on using the result corrects."""
    folder = shutil.copytree(demo.folder, tmp_path_factory.mktemp("use") / "project")
    (folder / "SEAM.LS").write_text(SEAM)
    return folder


def test_the_report_says_what_the_readme_shows(project):
    first = next(b.text for b in blocks() if b.heading == USE and b.language == "sh")

    assert_shown(block("output: ladder").text, run(first, project))


@pytest.mark.parametrize("number", range(1, sum(b.heading == USE and b.language == "sh" for b in blocks())))
def test_the_blocks_that_use_the_result_run_in_a_copy_of_the_demo(number, project):
    use = [b.text for b in blocks() if b.heading == USE and b.language == "sh"]

    said = run(use[number], project)

    assert "left as they are" not in said
    assert "out of reach" not in said


def test_the_cell_files_are_read(tmp_path):
    cells = [b for b in (*blocks(), *blocks(REAL_ROBOT)) if b.language == "yaml" and b.text.startswith("robot:")]

    for cell in cells:
        (tmp_path / "cell.yaml").write_text(cell.text)
        read_cell(tmp_path / "cell.yaml")

    assert len(cells) >= 2


def test_the_run_on_a_real_robot_gives_what_its_page_shows(shared_data, tmp_path):
    (tmp_path / "cell.yaml").write_text(block("file: cell.yaml", REAL_ROBOT).text + "\n")

    said = run(block("needs: IRB120", REAL_ROBOT).text, tmp_path, IRB120=str(shared_data / "irb120"))

    assert_shown(block("output: irb120", REAL_ROBOT).text, said)


def test_the_library_is_used_as_the_readme_shows(capsys):
    for example in (b.text for b in blocks() if b.language == "python"):
        exec(example, {})

    indices, numbers = capsys.readouterr().out.rsplit("]", 1)
    assert len(indices.strip("[").split()) == 50
    assert 0.9 < float(numbers.split()[1]) <= 1


def test_no_shell_block_is_left_unrun():
    run_somewhere = {"Run the demo", "Run the tests", "The loop", "Try it without a robot", USE}

    assert {b.heading for b in blocks() if b.language == "sh"} == run_somewhere
