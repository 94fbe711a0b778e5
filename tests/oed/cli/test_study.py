"""`touchcal study`: alone, it lists every study with its question."""

import pytest

from oed.cli import main
from studies import STUDIES


def test_the_command_alone_lists_every_study_with_its_question(capsys):
    with pytest.raises(SystemExit, match="0"):
        main(["study"])

    lines = capsys.readouterr().out.splitlines()
    assert [line.split()[0] for line in lines] == list(STUDIES)
    assert all(line.endswith("?") for line in lines)
