"""The studies' engine: the same table whatever the order, nothing computed twice, and a README made from scripts."""

from types import ModuleType

import numpy as np
import pytest

from studies.engine import Study, evaluate, here, where


@pytest.fixture
def study(tmp_path, monkeypatch):
    """A study of three tasks, each of which draws two numbers."""
    source = tmp_path / "toy.py"
    source.write_text('"""A toy?"""\n')
    module = ModuleType("studies.toy", "A toy?\n\nSetup: none.\n\nAnswer: none.")
    module.__file__ = str(source)
    module.tasks = lambda small: [{"k": k} for k in range(3)]
    module.run = lambda rng, k: [{"k": k, "word": f"a, {k}", "drawn": rng.standard_normal()} for _ in range(2)]
    module.answer = lambda table: f"{len(table['k'])} rows"
    module.pictures = lambda table: {"toy": "<svg/>"}
    monkeypatch.setitem(__import__("sys").modules, "studies.toy", module)
    return Study("toy", module)


def test_a_changed_script_is_computed_again(study, tmp_path):
    evaluate(study, tmp_path, small=False, seed=3)
    (tmp_path / "toy.py").write_text('"""Another toy?"""\n')
    asked = []

    def watched(name, tasks, seed):
        asked.extend(index for index, _ in tasks)
        yield from here(name, tasks, seed)

    evaluate(study, tmp_path, small=False, seed=3, using=watched)

    assert asked == [0, 1, 2]


def test_numbers_travel_through_the_files_to_the_last_bit(study, tmp_path):
    rows = study.module.run(np.random.default_rng(np.random.SeedSequence(3, spawn_key=_spawned("toy", {"k": 1}))), k=1)

    table = evaluate(study, tmp_path, small=False, seed=3)

    assert where(table, k=1)["drawn"] == [row["drawn"] for row in rows]
    assert where(table, k=1)["word"] == ["a, 1", "a, 1"]


def _spawned(name, task):
    import hashlib
    import json

    return tuple(hashlib.sha256(f"{name} {json.dumps(task, sort_keys=True)}".encode()).digest()[:16])
