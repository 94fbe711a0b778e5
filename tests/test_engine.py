"""The studies' engine: the same table whatever the order, nothing computed twice, and a README made from scripts."""

from types import ModuleType

import numpy as np
import pytest

from identify.model.files import InputError
from studies import PICTURES, STUDIES, engine
from studies.engine import Study, column, compute, evaluate, here, joined, where, write_results
from studies.readme import readme


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


def backwards(name, tasks, seed):
    """Tasks in another order, as a cluster finishes them."""
    yield from here(name, list(tasks)[::-1], seed)


def test_the_table_does_not_depend_on_the_order_in_which_tasks_finish(study, tmp_path):
    forth = evaluate(study, tmp_path / "a", small=False, seed=3)
    back = evaluate(study, tmp_path / "b", small=False, seed=3, using=backwards)

    assert forth == back
    assert forth["k"] == [0, 0, 1, 1, 2, 2]
    assert len(set(forth["drawn"])) == 6


def test_another_seed_draws_other_numbers(study, tmp_path):
    first = evaluate(study, tmp_path, small=False, seed=3)
    second = evaluate(study, tmp_path, small=False, seed=4)

    assert not set(first["drawn"]) & set(second["drawn"])


def test_a_run_that_was_killed_goes_on_with_what_is_missing(study, tmp_path):
    def dies(name, tasks, seed):
        yield from list(here(name, tasks, seed))[:2]
        raise KeyboardInterrupt

    asked = []

    def watched(name, tasks, seed):
        asked.extend(index for index, _ in tasks)
        yield from here(name, tasks, seed)

    with pytest.raises(KeyboardInterrupt):
        evaluate(study, tmp_path, small=False, seed=3, using=dies)
    table = evaluate(study, tmp_path, small=False, seed=3, using=watched)

    assert asked == [2]
    assert table == evaluate(study, tmp_path / "fresh", small=False, seed=3)


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


def test_results_are_a_table_and_pictures(study, tmp_path):
    table = evaluate(study, tmp_path, small=False, seed=3)

    files = write_results(study, table, tmp_path / "out")

    assert [path.name for path in files] == ["toy.csv", "toy.svg"]
    again = engine.read_table(files[0])
    assert again == table


def test_tables_with_different_columns_stand_one_below_the_other():
    table = joined([{"a": [1.0], "b": ["x"]}, {"a": [2.0], "c": [5.0]}])

    assert table["a"] == [1.0, 2.0]
    assert np.isnan(column(table, "c")[0])
    assert column(table, "c")[1] == 5.0


def test_a_study_that_is_not_there_is_answered_with_those_that_are():
    with pytest.raises(InputError, match=f"there is no study 'obserability'.*{STUDIES[0]}"):
        Study.named("obserability")


def test_a_task_is_computed_the_same_anywhere(study):
    assert compute("toy", {"k": 2}, 3) == compute("toy", {"k": 2}, 3)


def test_the_readme_of_the_studies_is_made_from_the_scripts():
    assert (PICTURES.parent / "README.md").read_text(encoding="utf-8") == readme()


@pytest.mark.parametrize("name", STUDIES)
def test_every_study_tells_question_setup_and_answer_and_has_a_picture(name):
    story = Study.named(name).story
    question, _, rest = story.partition("\n\n")

    assert question.rstrip().endswith("?")
    assert rest.startswith("Setup: ")
    assert "\n\nAnswer: " in rest
    assert any(digit in rest.partition("Answer: ")[2] for digit in "0123456789")
    assert list(PICTURES.glob(f"{name}*.svg"))
