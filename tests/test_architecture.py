"""The arrows between packages and between rooms: who may import whom, read off the source with ast."""

import ast
import re
import subprocess
import sys
from graphlib import CycleError, TopologicalSorter
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
PACKAGES = ("identify", "oed", "probe", "studies")
THIRD = ("casadi", "serial")

# the rooms of each package: one may import those that stand before it, never those behind it
ROOMS = {
    "identify": (
        "model.compiled",
        "model",
        "model.urdf",
        "model.io",
        "uncertainty",
        "estimation",
        "compensation",
        "workpiece",
        "health",
        "programs",
        "export",
        "pendant",
        "report",
    ),
    "probe": ("line", "motion", "controllers", "runs", "programs", "virtual"),
    "oed": ("criteria", "design", "candidates", "refinement", "planning", "campaigns", "cli"),
}
DOORS = ("identify.model", "identify.uncertainty")  # what probe, and planning apart from the closed loop, may see
CLOSED_LOOP = ("oed.planning", "oed.campaigns", "oed.cli")  # they see the rest of identify and probe
SYMBOLS = (  # where CasADi stands: the model, what builds an NLP, and an example of a joint error
    "identify.model",
    "identify.estimation",
    "identify.compensation",
    "oed.refinement",
    "studies.examples",
)
MODULES, LINES, FUNCTION = 20, 300, 60  # in a folder, of a file, of a function: at most
UNTESTED = {  # modules without a test file of their own, and why
    "types and constants": (
        "identify.model.joint",
        "identify.model.io.schema",
        "identify.programs.records",
        "oed.campaigns.stages",
        "probe.line.controller",
        "probe.motion.settings",
        "probe.runs.events",
        "probe.virtual.records",
    ),
    "the whole loop: test_demo runs it": ("oed.campaigns.demonstration",),
    "makers: test_makers runs over their table": tuple(
        f"probe.programs.{maker}" for maker in ("abb", "fanuc", "kuka", "ur", "yaskawa")
    ),
    "studies: test_studies runs over their table": tuple(
        f"studies.{study}"
        for study in ("beyond", "campaign", "jigs.jig_shown", "kinds", "paper", "promise", "setups", "touches")
    ),
    "examples: test_examples runs over their folder": ("studies.examples",),
    "other libraries, which need not be there": tuple(
        f"studies.racers.with_{peer}" for peer in ("cvxpy", "figaroh", "pybotics")
    ),
    "scripts that write pages and pictures": ("studies.pages", "studies.screenshot"),
}


def within(module, *packages):
    """Whether a module is one of these packages or stands inside one."""
    return any(module == p or module.startswith(p + ".") for p in packages)


def room_of(module):
    """The package of a module, and its room there; none for the package itself and for what stands beside rooms."""
    package, _, rest = module.partition(".")
    rooms = [room for room in ROOMS.get(package, ()) if within(rest, room)]
    return package, max(rooms, key=len, default=None)


def complaint(module, target):
    """Why a module may not import a target, or nothing (DESIGN section 1)."""
    if within(target, "casadi"):
        return "" if within(module, *SYMBOLS) else "CasADi stays in the model and where an NLP is built"
    if within(target, "serial"):
        return "" if module == "probe.line.transport" else "the serial port is opened in probe.line.transport alone"
    (package, room), (other, into) = room_of(module), room_of(target)
    if package == other:
        return rooms_complaint(package, room, into) if room else ""
    if package == "studies" or (module == "oed.cli.study" and other == "studies"):
        return ""
    if package == "probe":
        return "" if within(target, *DOORS) else "probe knows nothing of ours but the model and its uncertainty"
    if package == "oed" and other in ("identify", "probe"):
        free = within(target, *DOORS, "probe.motion") or within(module, *CLOSED_LOOP)
        return "" if free else "only the closed loop knows all of identify and probe"
    return "the arrows go from studies to oed to probe to identify"


def rooms_complaint(package, room, into):
    """Why a room may not import another one of its package, or nothing."""
    if into is None:
        return f"a room knows the rooms before it, not the front of {package}"
    if "virtual" in (room, into) and room != into:
        return "the virtual cell and the driver share nothing: an error in both would cancel itself"
    order = ROOMS[package]
    return "" if order.index(into) <= order.index(room) else f"{room} stands before {into}"


def name_of(path, root):
    parts = path.relative_to(root).with_suffix("").parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


def exists(module, root):
    path = root.joinpath(*module.split("."))
    return path.is_dir() or path.with_suffix(".py").is_file()


def targets(node, package, root):
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


def imports(root):
    """Place, module and target of every import below `root`, anywhere in a file, in functions too."""
    for path in sorted(p for package in PACKAGES for p in (root / package).rglob("*.py")):
        module = name_of(path, root)
        package = module if path.name == "__init__.py" else module.rpartition(".")[0]
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            for target in targets(node, package, root):
                if within(target, *PACKAGES, *THIRD):
                    yield f"{path.relative_to(root)}:{node.lineno}", module, target


def violations(root):
    """Every import in the packages below `root` that goes against the arrows."""
    return [
        f"{place}: {module} imports {target}: {why}"
        for place, module, target in imports(root)
        if (why := complaint(module, target))
    ]


def circle(root):
    """Modules that import each other in a circle, or nothing; a package's front loads its modules on demand."""
    graph = {}
    for _, module, target in imports(root):
        if within(target, *PACKAGES) and target != module and module not in PACKAGES:
            graph.setdefault(module, set()).add(target)
    try:
        TopologicalSorter(graph).prepare()
    except CycleError as error:
        return error.args[1]
    return []


def oversized(root):
    """Folders with too many modules, files with too many lines, functions that are too long."""
    found = []
    for folder in sorted({p.parent for package in PACKAGES for p in (root / package).rglob("*.py")}):
        files = [p for p in sorted(folder.glob("*.py")) if p.name != "__init__.py"]
        if len(files) > MODULES:
            found.append(f"{folder.relative_to(root)} holds {len(files)} modules")
        for path in files:
            text = path.read_text(encoding="utf-8")
            if (lines := text.count("\n")) > LINES:
                found.append(f"{path.relative_to(root)} has {lines} lines")
            found += [
                f"{path.relative_to(root)}:{node.lineno}: {node.name} is longer than {FUNCTION} lines"
                for node in ast.walk(ast.parse(text))
                if isinstance(node, ast.FunctionDef) and node.end_lineno - node.lineno >= FUNCTION
            ]
    return found


def without_tests(root):
    """Modules without a test file of their own that are not on the list, and those on the list that have one."""
    listed = [module for modules in UNTESTED.values() for module in modules]
    paths = [p for package in PACKAGES for p in (root / package).rglob("*.py") if not p.stem.startswith("__")]
    tested = {name_of(p, root): (root / "tests" / p.relative_to(root)).with_name(f"test_{p.name}") for p in paths}
    missing = [m for m, test in tested.items() if not test.is_file() and not within(m, *listed)]
    needless = [m for m in listed if not any(within(other, m) and not test.is_file() for other, test in tested.items())]
    return sorted(missing), sorted(needless)


def test_every_import_follows_the_arrows():
    assert violations(ROOT) == []


def test_no_modules_import_each_other_in_a_circle():
    assert circle(ROOT) == []


def test_folders_files_and_functions_stay_small():
    assert oversized(ROOT) == []


def test_every_module_has_a_test_file_of_its_own_or_a_reason_to_have_none():
    assert without_tests(ROOT) == ([], [])


def test_every_room_of_the_table_is_a_folder_or_a_module_and_has_a_map():
    for package, rooms in ROOMS.items():
        for room in rooms:
            assert exists(f"{package}.{room}", ROOT), room
        for folder in (p.parent for p in (ROOT / package).rglob("__init__.py")):
            assert ast.get_docstring(ast.parse((folder / "__init__.py").read_text(encoding="utf-8"))), folder


def test_the_map_of_a_room_names_each_of_its_modules_once():
    for path in (p for package in PACKAGES for p in (ROOT / package).rglob("__init__.py")):
        lines = ast.get_docstring(ast.parse(path.read_text(encoding="utf-8"))).splitlines()
        named = [match[1] for line in lines if (match := re.match(r" {4}(\w+) ", line))]
        modules = {p.stem for p in path.parent.glob("*.py")} - {"__init__", "__main__"}
        rooms = {p.parent.name for p in path.parent.glob("*/__init__.py")}
        assert sorted(named) == sorted(modules | rooms), path.relative_to(ROOT)


PLANTED = {
    "the model knows what uses it": ("identify/model/robot.py", "from identify.estimation.calibrate import calibrate"),
    "the model knows its package": ("identify/model/robot.py", "import identify"),
    "the model knows a planner": ("identify/model/robot.py", "import oed.criteria"),
    "the model knows its files": ("identify/model/robot.py", "from identify.model.io import tables"),
    "uncertainty knows estimation": ("identify/uncertainty/promise.py", "import identify.estimation.calibrate"),
    "estimation knows the report": ("identify/estimation/calibrate.py", "from identify.report import page"),
    "identification knows planning": ("identify/estimation/calibrate.py", "import oed"),
    "identification knows touching": ("identify/estimation/calibrate.py", "from probe.runs import session"),
    "identification knows studies": ("identify/report/page.py", "from studies import value"),
    "touching knows identification": ("probe/runs/session.py", "from identify.estimation.calibrate import calibrate"),
    "touching knows the package around the model": ("probe/runs/session.py", "from identify import calibrate"),
    "touching knows planning": ("probe/runs/session.py", "import oed.criteria as c"),
    "motion knows runs": ("probe/motion/edges.py", "from probe.runs import session"),
    "the virtual cell reads lines as the driver does": ("probe/virtual/line.py", "from probe.line.link import unseal"),
    "the driver knows the virtual cell": ("probe/line/link.py", "from probe.virtual.line import crc"),
    "design knows identification": ("oed/design/exact.py", "from identify.estimation import calibrate"),
    "candidates know touching": ("oed/candidates/even.py", "import numpy, probe.runs.session"),
    "criteria know planning": ("oed/criteria/table.py", "from oed.planning import plan"),
    "planning knows studies": ("oed/planning/plan.py", "import studies"),
    "in a function": ("oed/design/exact.py", "def f():\n    from probe.runs import session"),
    "under a condition": ("oed/design/exact.py", "if True:\n    import probe.runs.session"),
    "relative": ("identify/model/robot.py", "from ..estimation import calibrate"),
    "relative, from a package": ("identify/model/__init__.py", "from .. import estimation"),
    "by name": ("probe/runs/session.py", "import importlib\nimportlib.import_module('oed.criteria')"),
    "symbols in planning": ("oed/planning/plan.py", "import casadi as ca"),
    "symbols in touching": ("probe/runs/session.py", "from casadi import SX"),
    "symbols in uncertainty": ("identify/uncertainty/promise.py", "def f():\n    import casadi"),
    "a second serial port": ("probe/runs/session.py", "import serial.tools.list_ports"),
    "a serial port in the command line": ("oed/cli/run.py", "from serial import Serial"),
}
INNOCENT = {
    "the doors": ("probe/runs/session.py", "from identify.model.robot import Robot\nfrom identify import uncertainty"),
    "the model by itself": ("identify/model/jig.py", "from identify.model.robot import Robot\nfrom . import robot"),
    "files see the model": ("identify/model/io/tables.py", "from identify.model import robot"),
    "design sees the model": ("oed/design/exact.py", "import identify.model.robot\nfrom oed import criteria"),
    "candidates see motion": ("oed/candidates/even.py", "from probe.motion import edges"),
    "the loop is closed": ("oed/campaigns/campaign.py", "from probe.runs import session\nimport identify.estimation"),
    "the command of studies": ("oed/cli/study.py", "from studies import value"),
    "the command line": ("oed/cli/plan.py", "def f():\n    from identify import estimation\n    import probe.runs"),
    "studies import anything": ("studies/value.py", "import oed.planning.plan, probe.runs.session, identify"),
    "symbols where they belong": ("oed/refinement/coordinate.py", "import casadi"),
    "symbols in the model": ("identify/model/compiled/batch.py", "import casadi"),
    "the serial port": ("probe/line/transport.py", "import serial"),
    "names that only begin alike": ("probe/runs/session.py", "import serialize, oedema\nfrom probed import x"),
}


@pytest.fixture
def house(tmp_path):
    """A tree with all rooms, and in them the modules of this test, all empty."""
    rooms = [f"{package}/{room.replace('.', '/')}/__init__" for package, names in ROOMS.items() for room in names]
    modules = [file.removesuffix(".py") for file, _ in (*PLANTED.values(), *INNOCENT.values())]
    more = ["identify/estimation/calibrate", "identify/report/page", "oed/planning/plan", "probe/motion/edges"]
    for module in [*rooms, *modules, *more, *(f"{package}/__init__" for package in PACKAGES)]:
        path = tmp_path / f"{module}.py"
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text("")
    return tmp_path


@pytest.mark.parametrize("kind", PLANTED)
def test_a_planted_violation_is_reported_with_its_place(house, kind):
    file, text = PLANTED[kind]
    (house / file).write_text(text)

    found = violations(house)

    last = 1 + text.count("\n")
    assert len(found) == 1
    assert found[0].startswith(f"{file}:{last}: ")


@pytest.mark.parametrize("kind", INNOCENT)
def test_what_the_arrows_allow_is_not_reported(house, kind):
    file, text = INNOCENT[kind]
    (house / file).write_text(text)

    assert violations(house) == []


def test_a_planted_circle_is_reported_even_where_one_arrow_stands_in_a_function(house):
    (house / "identify/model/robot.py").write_text("import identify.model.jig")
    (house / "identify/model/jig.py").write_text("def f():\n    from identify.model import robot")

    assert {"identify.model.robot", "identify.model.jig"} <= set(circle(house))


@pytest.mark.parametrize("planted", ["modules", "lines", "function"])
def test_a_planted_excess_is_reported(house, planted):
    if planted == "modules":
        for k in range(MODULES + 1):
            (house / f"oed/design/m{k}.py").write_text("")
    elif planted == "lines":
        (house / "oed/design/long.py").write_text("x = 1\n" * (LINES + 1))
    else:
        (house / "oed/design/long.py").write_text("def f():\n" + "    x = 1\n" * FUNCTION)

    assert len(oversized(house)) == 1


def test_a_module_without_tests_and_a_reason_that_is_none_are_reported(house):
    tested = house / "tests/probe/runs/test_events.py"
    tested.parent.mkdir(parents=True)
    tested.write_text("")
    (house / "probe/runs/events.py").write_text("")  # on the list, with a test file all the same

    missing, needless = without_tests(house)

    assert "oed.design.exact" in missing
    assert "probe.runs.events" in needless


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
print(sorted(n for n in loaded("probe") if not allowed(n, "identify.model", "identify.uncertainty", "probe")))
print(sorted(n for n in loaded("identify") if not allowed(n, "identify", "probe")))
"""

    run = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, cwd=ROOT, check=False)

    assert run.stdout.splitlines() == ["[]"] * 3, run.stderr


def test_nothing_else_stands_at_the_top_level():
    listed = subprocess.run(["git", "ls-files"], capture_output=True, text=True, cwd=ROOT, check=False)
    if listed.returncode:
        pytest.skip("not a git checkout, so there is no list of what belongs to it")

    top = {line.split("/")[0] for line in listed.stdout.splitlines() if not line.startswith(".")}

    assert top <= {*PACKAGES, "tests", "pyproject.toml", "requirements.lock", "README.md", "LICENSE"}
