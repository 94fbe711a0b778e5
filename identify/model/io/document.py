"""YAML files read with the place of every key, so that every mistake is told with its line."""

import re
from io import StringIO
from pathlib import Path
from typing import Any, TypeVar

from pydantic import ValidationError
from ruamel.yaml import YAML
from ruamel.yaml.comments import CommentedMap, CommentedSeq
from ruamel.yaml.error import MarkedYAMLError
from ruamel.yaml.reader import ReaderError

from identify.model.files import InputError, Mistake, nearest, read_text
from identify.model.io.schema import Strict

Model = TypeVar("Model", bound=Strict)

UNDERSCORED = re.compile(r"(?<![\w.\"'/-])[-+]?\d[\d.]*_[\d_.]*(?![\w:/\"'-])")  # YAML would read 1_0 as 10
COMMA = re.compile(r"(?<=:)\s*[-+]?\d+,\d+\s*(?=[,}]|$)")  # YAML would read {x: 12,5} as x: 12 and a key 5

DEEPEST = 50  # brackets in brackets: the parser takes minutes for thousands


class Document:
    """A YAML file parsed with the place of every key."""

    def __init__(self, path: Path) -> None:
        self.path = path
        text = read_text(path)
        if text.lstrip().startswith("<"):
            cure = "touchcal init --robot makes a cell of a URDF"
            raise InputError([Mistake(str(path), 0, f"this is XML, expected a file in YAML; {cure}")])
        if _depth(text) > DEEPEST:
            raise InputError([Mistake(str(path), 0, f"brackets stand more than {DEEPEST} deep; close them")])
        for number, row in enumerate(text.split("\n"), 1):
            if match := UNDERSCORED.search(row.partition("#")[0]):
                cure = "write it without the underscore, or as a name in quotation marks"
                raise InputError([Mistake(str(path), number, f"{match[0].strip()} looks like a number; {cure}")])
            if match := COMMA.search(row.partition("#")[0]):
                raise InputError([Mistake(str(path), number, decimal_comma(match[0].strip()))])
        try:
            self.data: Any = YAML().load(text)
        except MarkedYAMLError as error:
            line = error.problem_mark.line + 1 if error.problem_mark else 0
            raise InputError([Mistake(str(path), line, f"not valid YAML: {error.problem}")]) from None
        except ReaderError as error:
            line = text.count("\n", 0, error.position) + 1
            raise InputError([Mistake(str(path), line, f"not valid YAML: {error.reason}")]) from None
        except (ValueError, RecursionError) as error:  # a date of month 13, brackets a thousand deep
            raise InputError([Mistake(str(path), 0, f"not valid YAML: {error}")]) from None

    def line(self, location: tuple[int | str, ...]) -> int:
        """The line of a key, or of the nearest thing around it that has one."""
        node, line = self.data, 1
        for key in location:
            if isinstance(node, CommentedMap) and key in node:
                line = node.lc.key(key)[0] + 1
            elif isinstance(node, CommentedSeq) and isinstance(key, int) and key < len(node):
                line = node.lc.item(key)[0] + 1
            else:
                break
            node = node[key]
        return line

    def wrong(self, text: str, *location: int | str) -> Mistake:
        """A mistake at a key of this file."""
        return Mistake(str(self.path), self.line(location), text)

    def with_key(self, key: str, value: Any) -> str:
        """The text of the file with another value of a key of the first level, comments kept; None removes the key."""
        if value is None:
            self.data.pop(key, None)
        else:
            self.data[key] = flow(value)
        out = StringIO()
        _writer().dump(self.data, out)
        return out.getvalue()

    def get(self, key: str) -> Any:
        """What stands at a key, unchecked; None where nothing does."""
        return self.data.get(key) if isinstance(self.data, dict) else None

    def items(self, key: str) -> list[Any]:
        """The items of a list, unchecked; none where there is no list."""
        value = self.get(key)
        return value if isinstance(value, list) else []


def decimal_comma(number: str) -> str:
    """What is wrong with a number such as 12,5."""
    return f"{number} has a decimal comma; write {number.replace(',', '.')}"


def _depth(text: str) -> int:
    """How deep brackets stand in brackets."""
    depth = deepest = 0
    for bracket in re.findall(r"[\[{\]}]", text):
        depth += 1 if bracket in "[{" else -1
        deepest = max(deepest, depth)
    return deepest


def flow(value: Any) -> Any:
    """A value that YAML writes on one line."""
    if not isinstance(value, dict | list):
        return value
    node: CommentedMap | CommentedSeq
    if isinstance(value, dict):
        node = CommentedMap({k: flow(v) for k, v in value.items()})
    else:
        node = CommentedSeq(map(flow, value))
    node.fa.set_flow_style()
    return node


def line_text(key: str, value: Any) -> str:
    """`key: value` as one line of YAML."""
    out = StringIO()
    _writer().dump({key: flow(value)}, out)
    return out.getvalue().rstrip("\n")


def _writer() -> YAML:
    yaml = YAML()
    yaml.width, yaml.preserve_quotes = 4096, True
    return yaml


def load(path: Path, model: type[Model]) -> tuple[Model, Document]:
    """Read and validate a YAML file; raises InputError with every mistake."""
    document = Document(path)
    file, mistakes = validated(document, model)
    if file is None:
        raise InputError(mistakes)
    return file, document


def validated(document: Document, model: type[Model]) -> tuple[Model | None, list[Mistake]]:
    """What a file holds, or what is wrong with its form."""
    if not isinstance(document.data, dict):
        keys = ", ".join(list(model.model_fields)[:3])
        return None, [Mistake(str(document.path), 1, f"expected keys such as {keys}")]
    try:
        return model.model_validate(document.data), []
    except ValidationError as error:
        return None, [_mistake(document, model, e) for e in error.errors()]


def usable(raw: Any, model: type[Model]) -> Model | None:
    """What can be read of an entry without the keys that are wrong; None where nothing can."""
    for _ in range(2):
        try:
            return model.model_validate(raw)
        except ValidationError as error:
            wrong = {e["loc"][0] for e in error.errors() if e["loc"]}
            raw = {key: value for key, value in raw.items() if key not in wrong} if isinstance(raw, dict) else None
    return None


def entries(document: Document, key: str, model: type[Model]) -> list[tuple[int, Model]]:
    """The items of a list that can be read, with their places."""
    entries = [(i, usable(item, model)) for i, item in enumerate(document.items(key))]
    return [(i, entry) for i, entry in entries if entry is not None]


def _mistake(document: Document, model: type[Strict], error: Any) -> Mistake:
    """One of pydantic's findings as a sentence with its line."""
    location = tuple(part for part in error["loc"] if not str(part).startswith("<"))  # tags of the unions
    where = ".".join(str(part) for part in location)
    if error["type"] == "extra_forbidden":
        known_keys = _known_keys(model, location[:-1])
        return document.wrong(
            f"unknown key '{where}'{nearest(str(location[-1]), known_keys)}; known: {', '.join(known_keys)}", *location
        )
    if error["type"] == "missing":
        return document.wrong(f"key '{where}' is missing", *location)
    if isinstance(error["input"], str) and COMMA.fullmatch(":" + error["input"], 1):
        return document.wrong(f"{where}: {decimal_comma(error['input'])}", *location)
    return document.wrong(f"{where} is {error['input']!r}: {error['msg'][0].lower()}{error['msg'][1:]}", *location)


def _known_keys(model: type[Strict], location: tuple[int | str, ...]) -> list[str]:
    """The keys allowed at a place of a file."""
    entry: Any = model
    for part in location:
        if isinstance(part, str):
            entry = next(iter(_models_in(entry.model_fields[part].annotation)), None) if entry else None
    return list(entry.model_fields) if entry else []


def _models_in(annotation: Any) -> list[type[Strict]]:
    if isinstance(annotation, type) and issubclass(annotation, Strict):
        return [annotation]
    return [m for argument in getattr(annotation, "__args__", ()) for m in _models_in(argument)]
