"""The front of every package: found by completion, help and type checkers, and loaded when it is used."""

import ast
import pydoc
import subprocess
import sys
from importlib import import_module
from pathlib import Path

import pytest

PACKAGES = ("identify", "oed", "probe", "studies")
SCREEN = 68  # lines of a tall terminal: the front, the rooms, and the list of modules that pydoc adds


def declared(package):
    """Names that type checkers see, with their modules."""
    tree = ast.parse(Path(import_module(package).__file__).read_text(encoding="utf-8"))
    block = next(node for node in tree.body if isinstance(node, ast.If) and ast.unparse(node.test) == "TYPE_CHECKING")
    return {alias.asname: node.module for node in block.body for alias in node.names}


@pytest.mark.parametrize("package", PACKAGES)
def test_a_name_that_type_checkers_see_is_that_of_its_module(package):
    front = import_module(package)

    for name, module in declared(package).items():
        assert getattr(front, name) is getattr(import_module(module), name)
        assert name in dir(front)
    rooms = {path.parent.name for path in Path(front.__file__).parent.glob("*/__init__.py")}
    assert rooms.isdisjoint(declared(package))  # a room that is loaded hides a function of its name
    assert {name for names in front._FRONT.values() for name in names.split()} == set(declared(package))


@pytest.mark.parametrize("package", PACKAGES)
def test_help_names_the_front_and_fits_one_screen(package):
    text = pydoc.plain(pydoc.render_doc(import_module(package)))

    assert [name for name in declared(package) if name not in text.partition("FILE")[0]] == []
    assert len(text.splitlines()) <= SCREEN


@pytest.mark.parametrize("package", PACKAGES)
def test_a_name_that_is_not_there_is_no_attribute(package):
    with pytest.raises(AttributeError, match=f"module '{package}' has no attribute 'plam'"):
        import_module(package).__getattr__("plam")


def test_importing_the_packages_and_completing_their_names_loads_nothing_that_takes_time():
    script = "import sys, identify, oed, probe, studies; dir(oed); print({'casadi', 'numpy', 'scipy'} & {*sys.modules})"

    run = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True)

    assert run.stdout == "set()\n"
