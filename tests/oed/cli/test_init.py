"""The JSON schemas of the files that a user writes, judged by another validator."""

import json

import jsonschema
import pytest
from ruamel.yaml import YAML

from identify.model.io.description import library
from oed.cli.init import schema_of

FILES = [(kind, name) for kind in ("cell", "robot", "jig") for name in library(f"{kind}s")]


def read(kind, name):
    return YAML(typ="safe").load(library(f"{kind}s")[name].read_text(encoding="utf-8"))


@pytest.mark.parametrize(("kind", "name"), FILES)
def test_a_file_of_the_library_keeps_to_its_schema_and_a_misspelled_key_does_not(kind, name):
    entry = read(kind, name)
    jsonschema.validate(entry, schema_of(kind))

    with pytest.raises(jsonschema.ValidationError, match="naem"):
        jsonschema.validate(entry | {"naem": 1}, schema_of(kind))


def test_the_command_prints_what_init_writes_and_the_cell_file_names(touchcal, tmp_path):
    code, printed, _ = touchcal("schema")
    touchcal("init", tmp_path / "cell")

    first = (tmp_path / "cell" / "cell.yaml").read_text().splitlines()[0]
    written = (tmp_path / "cell" / first.removeprefix("# yaml-language-server: $schema=")).read_text()

    assert code == 0
    assert json.loads(written) == json.loads(printed)
