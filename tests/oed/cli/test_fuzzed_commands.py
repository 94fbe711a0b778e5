"""Commands before mutated files: a few here, thousands by `python -m tests.identify.fuzz`."""

import pytest
from fuzz_commands import Commands


@pytest.fixture(scope="module")
def commands(tmp_path_factory: pytest.TempPathFactory) -> Commands:
    return Commands(tmp_path_factory.mktemp("fuzzed"))


@pytest.mark.usefixtures("unsynced")
def test_a_command_reads_a_mutated_file_or_refuses_it_in_one_sentence(commands: Commands) -> None:
    complaints = {seed: commands.complaint(seed) for seed in range(100)}

    assert {seed: text for seed, text in complaints.items() if text} == {}


def test_one_measurement_in_two_files_is_refused_and_nothing_is_written(commands: Commands) -> None:
    again = commands.kept / "again"
    again.mkdir()
    (again / "part.csv").write_bytes(b"".join((commands.kept / "touches.csv").read_bytes().splitlines(True)[:3]))

    code, said = commands.run("identify", "touches.csv", "again/part.csv", "-o", "new.json")

    assert (code, said) == (
        2,
        "again/part.csv: 't0' (2 rows in all) stands in touches.csv too; give each measurement once",
    )
    assert not (commands.kept / "new.json").exists()
