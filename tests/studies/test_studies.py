"""Every study of the table: a small run, its pictures, and what its first lines promise."""

import re
import xml.etree.ElementTree as ET

import numpy as np
import pytest

from identify.model.files import InputError
from studies import STUDIES, engine
from studies.engine import Study, compute, evaluate, joined, read_table, write_results

SVG = "{http://www.w3.org/2000/svg}"
UNIT = re.compile(r"\b(mm²?|deg|rad|minutes|hours?|s|ms|MB|GB|touches|sets|robots|%|times)\b|%")


@pytest.fixture(scope="module")
def ran(tmp_path_factory):
    """The tables of small runs, each made when it is first asked for, and their folders."""
    known = {}

    def small(name):
        if name not in known:
            folder = tmp_path_factory.mktemp(name)
            known[name] = evaluate(Study.named(name), folder, small=True, seed=0), folder
        return known[name]

    return small


def measured(study):
    """Columns that a clock or a machine wrote: they differ from run to run."""
    return getattr(study.module, "MEASURED", ())


@pytest.mark.parametrize("name", STUDIES)
def test_a_study_begins_with_question_setup_and_answer(name):
    paragraphs = Study.named(name).story.split("\n\n")

    assert paragraphs[0].rstrip().endswith("?")
    assert any(p.startswith("Setup:") for p in paragraphs)
    answer = next(p for p in paragraphs if p.startswith("Answer:"))
    assert re.search(r"\d", answer), "an answer has figures"


@pytest.mark.parametrize("name", STUDIES)
def test_a_small_run_gives_a_tidy_table_and_an_answer_with_numbers(name, ran):
    table, folder = ran(name)

    lengths = {len(cells) for cells in table.values()}
    assert len(lengths) == 1
    assert lengths.pop() > 0
    assert re.search(r"\d", Study.named(name).answer(table))
    assert len(list((folder / "chunks").iterdir())) == len(Study.named(name).tasks(small=True))


@pytest.mark.parametrize("name", STUDIES)
def test_a_table_that_was_written_is_read_again_as_it_was(name, ran, tmp_path):
    study, (table, _) = Study.named(name), ran(name)

    written = read_table(write_results(study, table, tmp_path)[0])

    assert written.keys() == table.keys()
    for column in table:
        assert all(a == b or (a != a and b != b) for a, b in zip(written[column], table[column], strict=True))


@pytest.mark.parametrize("name", STUDIES)
def test_the_same_seed_gives_the_same_rows(name, ran, tmp_path):
    study, (table, _) = Study.named(name), ran(name)
    task = study.tasks(small=True)[0]

    def rows(seed):
        (tmp_path / "rows.csv").write_text(compute(name, task, seed))
        return {k: v for k, v in read_table(tmp_path / "rows.csv").items() if k not in measured(study)}

    again = rows(0)
    count = len(next(iter(again.values())))
    for column, cells in again.items():
        assert all(a == b or (a != a and b != b) for a, b in zip(cells, table[column][:count], strict=True)), column


@pytest.mark.parametrize("name", STUDIES)
def test_pictures_are_svg_with_a_title_and_named_axes_with_units(name, ran):
    for file, text in Study.named(name).pictures(ran(name)[0]).items():
        root = ET.fromstring(text)
        texts = list(root.iter(f"{SVG}text"))
        said = [element.text or "" for element in texts]
        upright = [element.text for element in texts if "rotate(-90" in element.get("transform", "")]
        width = float(root.get("viewBox").split()[2])

        assert root.tag == f"{SVG}svg"
        assert len(root.get("aria-label")) > 20, file
        assert upright, f"{file}: no title of the y axis"
        assert any(UNIT.search(words) for words in said), f"{file}: no unit"
        assert not [words for words in said if "nan" in words.lower().split()], file
        for element in texts:
            if element.get("text-anchor") == "middle" and "rotate" not in element.get("transform", ""):
                half = 5.6 * len(element.text or "") / 2  # [px] of 11 and 12 px letters
                assert float(element.get("x")) - half > -6, f"{file}: '{element.text}' leaves the picture"
                assert float(element.get("x")) + half < width + 6, f"{file}: '{element.text}' leaves the picture"


def test_a_study_that_is_not_there_is_answered_with_the_nearest():
    with pytest.raises(InputError, match="did you mean 'observability'"):
        Study.named("observabilty")


def test_a_run_that_was_stopped_repeats_nothing_and_ends_with_the_same_table(monkeypatch, tmp_path):
    study = Study.named(STUDIES[0])
    tasks = [{"part": k} for k in range(5)]
    made = []

    def run(rng, part):
        made.append(part)
        return [{"part": part, "drawn": float(rng.standard_normal())} for _ in range(2)]

    monkeypatch.setattr(study.module, "tasks", lambda small: tasks)
    monkeypatch.setattr(study.module, "run", run)
    whole = evaluate(study, tmp_path / "whole", small=True, seed=1)
    made.clear()

    def broken(name, asked, seed):
        for index, task in asked[:3]:
            yield index, compute(name, task, seed)
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        evaluate(study, tmp_path / "part", small=True, seed=1, using=broken)
    table = evaluate(study, tmp_path / "part", small=True, seed=1)

    assert sorted(made) == [0, 1, 2, 3, 4]
    assert table == whole
    assert len(set(whole["drawn"])) == 10


def test_results_may_come_in_any_order(monkeypatch, tmp_path):
    study = Study.named(STUDIES[0])
    monkeypatch.setattr(study.module, "tasks", lambda small: [{"part": k} for k in range(4)])
    monkeypatch.setattr(study.module, "run", lambda rng, part: [{"part": part, "drawn": float(rng.random())}])

    forwards = evaluate(study, tmp_path / "a", small=True, seed=1)
    backwards = evaluate(
        study, tmp_path / "b", small=True, seed=1, using=lambda name, asked, seed: engine.here(name, asked[::-1], seed)
    )

    assert forwards == backwards


def test_chunks_of_another_seed_are_not_taken(monkeypatch, tmp_path):
    study = Study.named(STUDIES[0])
    monkeypatch.setattr(study.module, "tasks", lambda small: [{"part": 0}])
    monkeypatch.setattr(study.module, "run", lambda rng, part: [{"drawn": float(rng.random())}])

    drawn = [evaluate(study, tmp_path, small=True, seed=seed)["drawn"][0] for seed in (1, 2, 1)]

    assert drawn[0] == drawn[2] != drawn[1]


def test_tables_with_other_columns_are_joined_with_gaps():
    whole = joined([{"a": [1.0], "b": [2.0]}, {"a": [3.0], "c": ["x"]}])

    assert whole["a"] == [1.0, 3.0]
    assert whole["c"][1] == "x"
    assert np.isnan(whole["b"][1])
