"""Help: what it says of a command, and that it says it at once."""

import re
import subprocess
import sys
from importlib.metadata import version

import pytest

from oed.cli import COMMANDS, application
from oed.cli.screen.help import page

HEAVY = ("casadi", "scipy", "pydantic", "ruamel", "jaxtyping", "rich", "identify.model.robot", "probe", "studies")
PLACES = (
    "calibration",
    "directory",
    "kind",
    "name",
    "part",
    "plan",
    "poses",
)  # arguments that have a place may be named, too


@pytest.fixture(autouse=True)
def wide(monkeypatch):
    monkeypatch.setenv("COLUMNS", "100")


def in_a_process_of_its_own(*lines):
    """What Python prints that has loaded nothing yet."""
    script = "\n".join(("import sys", "from oed.cli import COMMANDS, explain, main", *lines))
    return subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True).stdout


@pytest.fixture(scope="module")
def said(tmp_path_factory):
    """All pages of help, and then what was loaded for them."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("COLUMNS", "100")
        told = in_a_process_of_its_own(
            "for name in ('', *COMMANDS): explain(name); print('=' * 9)",
            f"print([name for name in {HEAVY} if name in sys.modules])",
        )
    *pages, loaded = told.split("=========\n")
    return dict(zip(("", *COMMANDS), pages, strict=True)), loaded


def test_help_of_any_command_loads_nothing_that_takes_time(said):
    _, loaded = said

    assert loaded == "[]\n"


@pytest.mark.parametrize("command", COMMANDS)
def test_every_command_explains_itself_with_an_example(command, said):
    pages, _ = said

    assert f"touchcal {command}" in re.split("[Ee]xamples?:", pages[command])[1]
    assert f"  {command}  " in pages[""]


@pytest.mark.parametrize("command", COMMANDS)
def test_every_option_of_a_command_is_explained(command):
    arguments = application()[command].assemble_argument_collection(parse_docstring=True)

    assert [argument.name for argument in arguments if argument.show and not argument.parameter.help] == []


@pytest.mark.parametrize("command", COMMANDS)
def test_help_names_all_options(command, said):
    arguments = application()[command].assemble_argument_collection()
    names = [name for argument in arguments if argument.show for name in argument.names]

    options = re.findall(r"-[\w-]+", said[0][command])

    assert {name for name in names if name.startswith("-")} - {f"--{place}" for place in PLACES} <= set(options)


@pytest.mark.parametrize(
    ("command", "line"),
    [
        ("plan", "  -n, --touches INTEGER     How many touches to make; 50 if no target is given."),
        ("plan", "  --strategy optimal|even|random"),
        ("plan", "                            optimal; even spreads points over the faces as the paper does; random"),
        ("plan", "                            draws them. [default: optimal]"),
        ("plan", "  --json                    Print a machine-readable summary on stdout."),
        ("plan", "  --seed INTEGER            The same seed gives the same result. [default: 0]"),
        ("identify", "  FILES...                  touches.csv and positions.csv files, one or more."),
        ("identify", "  --priors, --no-priors     Use the tolerances of the cell file beside the touches (maximum a"),
        ("identify", "                            posteriori). [default: True]"),
        ("virtual", "  --fault TEXT...           A fault to order; may be given several times."),
        ("export", "Usage: touchcal export --format urdf|ur-yaml|dh-csv|json|mastering-text [OPTIONS] CALIBRATION"),
        ("export", "                            hand. [required]"),
        ("health", "                            [default: 0.01]"),
    ],
)
def test_an_option_stands_with_its_value_default_and_choices(command, line, said):
    assert line in said[0][command].splitlines()


def test_no_line_of_prose_is_longer_than_the_screen(said):
    examples = re.compile("    touchcal ")

    lines = [line for text in said[0].values() for line in text.splitlines() if not examples.match(line)]

    assert max(map(len, lines)) <= 100


@pytest.mark.parametrize(
    "words", [["plan", "--help"], ["--help", "plan"], ["plan", "-h"], ["plan", "--target", "--help"]]
)
def test_help_is_asked_for_at_any_place_of_the_line(words, touchcal, said):
    code, out, _ = touchcal(*words)

    assert (code, out) == (0, said[0]["plan"])


@pytest.mark.parametrize("words", [[], ["--help"], ["-h"]])
def test_help_without_a_command_names_them_all(words, touchcal, said):
    code, out, _ = touchcal(*words)

    assert (code, out) == (0, said[0][""])


def test_help_for_a_command_that_is_not_there_says_so(touchcal):
    code, out, err = touchcal("plam", "--help")

    assert (code, out) == (2, "")
    assert "there is no command 'plam'; did you mean 'plan'?" in err


def test_help_after_a_double_dash_is_a_word_like_others(touchcal):
    code, out, _ = touchcal("plan", "--", "--help")

    assert (code, out) == (2, "")


def test_a_command_works_after_its_help_was_read(tmp_path):
    told = in_a_process_of_its_own("for name in COMMANDS: explain(name)", f"main(['init', {str(tmp_path / 'cell')!r}])")

    assert "then: touchcal check" in told
    assert (tmp_path / "cell" / "cell.yaml").is_file()


def test_the_version_is_that_of_the_installed_packages_and_of_ipopt(touchcal):
    code, out, _ = touchcal("--version")

    assert code == 0
    assert re.fullmatch(rf"touchcal {version('touchcal')} \(CasADi {version('casadi')}, Ipopt \d+\.\d+\.\d+\)\n", out)


@pytest.mark.parametrize("columns", [60, 80])
def test_help_keeps_to_a_narrow_screen(columns, monkeypatch):
    monkeypatch.setenv("COLUMNS", str(columns))

    for command in COMMANDS:
        prose = [line for line in page(application()[command]).splitlines() if "touchcal " not in line]

        assert max(map(len, prose)) <= columns, command


@pytest.mark.parametrize("command", ["", *COMMANDS])
def test_help_says_what_exit_codes_mean(command, said):
    assert "Exit codes: 0 done; 1 the work failed" in said[0][command]
