"""Mutated files of every kind: a few here, thousands by `python -m tests.identify.fuzz`."""

from pathlib import Path

import pytest
from fuzz import Files


@pytest.mark.usefixtures("unsynced")
def test_a_mutated_file_is_read_or_refused_in_one_sentence(tmp_path: Path) -> None:
    files = Files(tmp_path)

    complaints = {seed: files.complaint(seed) for seed in range(100)}

    assert {seed: text for seed, text in complaints.items() if text} == {}
