"""The arrows between the rooms: who may import whom, read off the source with ast, and proof that this can fail."""

import ast
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
ROOMS = ("identify", "oed", "probe", "studies")
THIRD = ("casadi", "serial")


def within(module, *packages):
    """Whether a module is one of these packages or stands inside one."""
    return any(module == p or module.startswith(p + ".") for p in packages)


def is_command_line(module):
    return module == "oed.campaigns.campaign" or within(module, "oed.cli")


def may_use_casadi(module):
    # least_squares is the NLP of calibration, in a file of its own
    prefixes = (
        "identify.estimation.calibrate",
        "identify.estimation.least_squares",
        "identify.compensation.compensate",
        "oed.refinement.coordinate",
    )
    return within(module, "identify.model") or module.startswith(prefixes)


def complaint(module, target):
    """Why a module may not import a target, or nothing (DESIGN section 1)."""
    if target == "casadi" or target.startswith("casadi."):
        return "" if may_use_casadi(module) else "CasADi stays in the model, calibration, compensation and refinement"
    if target == "serial" or target.startswith("serial."):
        return "" if module == "probe.line.transport" else "the serial port is opened in probe.line.transport alone"
    if within(module, "probe") and within(target, "probe") and "probe.virtual" in (module[:13], target[:13]):
        apart = within(module, "probe.virtual") != within(target, "probe.virtual")
        return "the virtual cell and the driver share nothing: an error in both would cancel itself" if apart else ""
    room = module.split(".")[0]
    if room == "studies" or within(target, room):
        inward = within(module, "identify.model") and not within(target, "identify.model")
        return "identify.model is the vocabulary and knows nothing of what uses it" if inward else ""
    if room == "oed":
        known = ("identify", "probe", *(["studies"] if module == "oed.cli.study" else []))
        free = within(target, "identify.model") or (is_command_line(module) and within(target, *known))
        return (
            "" if free else "only oed.campaigns.campaign and oed.cli know identify and probe, oed.cli.study the studies"
        )
    if room == "probe":
        return "" if within(target, "identify.model") else "probe knows nothing of ours but identify.model"
    return "identify imports neither oed nor probe nor studies"


def name_of(path, root):
    parts = path.relative_to(root).with_suffix("").parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


def exists(module, root):
    path = root.joinpath(*module.split("."))
    return path.is_dir() or path.with_suffix(".py").is_file()


def targets(node, module, package, root):
    """The modules that one statement imports; `from x import y` is x.y where that is a module, else x."""
    if isinstance(node, ast.Import):
        return [alias.name for alias in node.names]
    if isinstance(node, ast.ImportFrom):
        above = package.split(".")[: len(package.split(".")) - node.level + 1] if node.level else []
        base = ".".join([*above, *([node.module] if node.module else [])])
        return [f"{base}.{a.name}" if exists(f"{base}.{a.name}", root) else base for a in node.names]
    if isinstance(node, ast.Call) and node.args and isinstance(node.args[0], ast.Constant):
        called = ast.unparse(node.func)
        if called in {"__import__", "import_module", "importlib.import_module"}:
            return [str(node.args[0].value)]
    return []


def violations(root):
    """Every import in the rooms below `root` that goes against the arrows, anywhere in a file, in functions too."""
    found = []
    for path in sorted(p for room in ROOMS for p in (root / room).rglob("*.py")):
        module = name_of(path, root)
        package = module if path.name == "__init__.py" else module.rpartition(".")[0]
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            found += [
                f"{path.relative_to(root)}:{node.lineno}: {module} imports {target}: {why}"
                for target in targets(node, module, package, root)
                if within(target, *ROOMS, *THIRD) and (why := complaint(module, target))
            ]
    return found


def test_every_import_follows_the_arrows():
    assert violations(ROOT) == []


def test_the_rooms_are_there_to_be_walked():
    for room in ROOMS:
        assert list((ROOT / room).rglob("*.py")), room


PLANTED = {
    "the model knows what uses it": ("identify/model/robot.py", "from identify.estimation.calibrate import calibrate"),
    "the model knows its package": ("identify/model/robot.py", "import identify"),
    "the model knows a planner": ("identify/model/robot.py", "import oed.criteria.criteria"),
    "identification knows planning": ("identify/estimation/calibrate.py", "import oed"),
    "identification knows touching": ("identify/estimation/calibrate.py", "from probe import session"),
    "identification knows studies": ("identify/report/page.py", "from studies import value"),
    "touching knows identification": ("probe/runs/session.py", "from identify.estimation.calibrate import calibrate"),
    "touching knows the package around the model": ("probe/runs/session.py", "from identify import calibrate"),
    "touching knows planning": ("probe/runs/session.py", "import oed.criteria.criteria as c"),
    "the virtual cell reads lines as the driver does": (
        "probe/virtual/line.py",
        "from probe.line.framing import unseal",
    ),
    "the driver knows the virtual cell": ("probe/line/link.py", "from probe.virtual.line import crc"),
    "planning knows identification": ("oed/planning/plan.py", "from identify import calibration"),
    "planning knows touching": ("oed/planning/plan.py", "import numpy, probe"),
    "planning knows studies": ("oed/planning/plan.py", "import studies"),
    "in a function": ("oed/planning/plan.py", "def f():\n    from probe import session"),
    "under a condition": ("oed/planning/plan.py", "if True:\n    import probe.runs.session"),
    "relative": ("identify/model/robot.py", "from ..calibration import calibrate"),
    "relative, from a package": ("identify/model/__init__.py", "from .. import calibration"),
    "by name": ("probe/runs/session.py", "import importlib\nimportlib.import_module('oed.criteria.criteria')"),
    "symbols in planning": ("oed/planning/plan.py", "import casadi as ca"),
    "symbols in touching": ("probe/runs/session.py", "from casadi import SX"),
    "symbols in identification at large": ("identify/uncertainty.py", "def f():\n    import casadi"),
    "a second serial port": ("probe/runs/session.py", "import serial.tools.list_ports"),
    "a serial port in the command line": ("oed/cli.py", "from serial import Serial"),
}
INNOCENT = {
    "the one door": ("probe/runs/session.py", "from identify.model.robot import Robot\nfrom identify import model"),
    "the model by itself": ("identify/model/jig.py", "from identify.model.robot import Robot\nfrom . import robot"),
    "planning sees the model": ("oed/planning/plan.py", "import identify.model.robot\nfrom oed import criteria"),
    "the loop is closed": ("oed/campaigns/campaign.py", "from probe import session\nfrom identify import calibration"),
    "the command of studies": ("oed/cli/study.py", "from studies import engine"),
    "the command line": (
        "oed/cli/plan.py",
        "def f():\n    from identify import calibrate\n    import probe.runs.session",
    ),
    "studies import anything": ("studies/value.py", "import oed.planning.plan, probe.runs.session, identify"),
    "symbols where they belong": ("oed/refinement/coordinate.py", "import casadi"),
    "symbols in the model": ("identify/model/compiled/batch.py", "import casadi"),
    "the serial port": ("probe/line/transport.py", "import serial"),
    "names that only begin alike": ("probe/runs/session.py", "import serialize, oedema\nfrom probed import x"),
}


@pytest.fixture
def house(tmp_path):
    """A tree with the rooms and some modules in it, all empty."""
    modules = ["identify/model/robot", "identify/calibration", "oed/criteria", "oed/planning", "probe/session"]
    for module in [*modules, "studies/value", *(f"{package}/__init__" for package in (*ROOMS, "identify/model"))]:
        path = tmp_path / f"{module}.py"
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text("")
    return tmp_path


def plant(house, file, text):
    (house / file).parent.mkdir(parents=True, exist_ok=True)
    (house / file).write_text(text)


@pytest.mark.parametrize("kind", PLANTED)
def test_a_planted_violation_is_reported_with_its_place(house, kind):
    file, text = PLANTED[kind]
    plant(house, file, text)

    found = violations(house)

    last = 1 + text.count("\n")
    assert len(found) == 1
    assert found[0].startswith(f"{file}:{last}: ")


@pytest.mark.parametrize("kind", INNOCENT)
def test_what_the_arrows_allow_is_not_reported(house, kind):
    plant(house, *INNOCENT[kind])

    assert violations(house) == []


def test_loading_a_room_loads_no_room_that_it_must_not_know():
    script = """
import importlib, pkgutil, sys
def loaded(package):
    for found in pkgutil.walk_packages(importlib.import_module(package).__path__, package + "."):
        if not found.name.endswith("__main__"):
            importlib.import_module(found.name)
    return {name for name in sys.modules if name.split(".")[0] in ("identify", "oed", "probe", "studies")}
allowed = lambda name, *rooms: name == "identify" or any(name == r or name.startswith(r + ".") for r in rooms)
print(sorted(n for n in loaded("identify.model") if not allowed(n, "identify.model")))
print(sorted(n for n in loaded("probe") if not allowed(n, "identify.model", "probe")))
print(sorted(n for n in loaded("identify") if not allowed(n, "identify", "probe")))
"""

    run = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, cwd=ROOT, check=False)

    assert run.stdout.splitlines() == ["[]"] * 3, run.stderr


def test_nothing_else_stands_at_the_top_level():
    listed = subprocess.run(["git", "ls-files"], capture_output=True, text=True, cwd=ROOT, check=False)
    if listed.returncode:
        pytest.skip("not a git checkout, so there is no list of what belongs to it")

    top = {line.split("/")[0] for line in listed.stdout.splitlines() if not line.startswith(".")}

    assert top <= {*ROOMS, "tests", "pyproject.toml", "requirements.lock", "README.md", "LICENSE"}
