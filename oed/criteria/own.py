"""Criteria of one's own: defined by a Python file, put into the table under their names."""

from dataclasses import dataclass
from pathlib import Path

from identify.model.files import InputError, read_text
from oed.criteria.criteria import CRITERIA
from oed.criteria.criterion import Criterion

PUBLISHED = frozenset(
    {*CRITERIA, "even", "random", "sequential"}
)  # names of published criteria, and of other strategies


@dataclass(frozen=True)
class OwnCriterion:
    """The text of a Python file and the variable in it that is a criterion: any process makes the same of them."""

    file: str
    variable: str
    text: str

    @classmethod
    def named(cls, words: str) -> "OwnCriterion | None":
        """That of FILE.py:NAME, None if the words are no such name; raises InputError where there is no file."""
        file, colon, variable = words.rpartition(":")
        if not colon or not file.endswith(".py"):
            return None
        if not Path(file).is_file():
            raise InputError(f"{file}: no such file; --criterion takes a name, or FILE.py:NAME")
        return cls(file, variable, read_text(Path(file)))

    def define(self) -> Criterion:
        """Run the text, and put the criterion into the table; raises InputError where it defines none."""
        variables = {"__name__": "own_criterion", "__file__": self.file}
        try:
            exec(compile(self.text, self.file, "exec"), variables)
        except Exception as error:
            raise InputError(f"{self.file}: {type(error).__name__}: {error}") from None
        value = variables.get(self.variable)
        if not isinstance(value, Criterion):
            what = "nothing" if value is None else f"a {type(value).__name__}"
            raise InputError(f"{self.file}: {self.variable} is {what}, expected a criterion such as PowerMean(...)")
        if value.name in PUBLISHED:
            raise InputError(f"{self.file}: the name '{value.name}' of {self.variable} is taken; give it another name")
        CRITERIA[value.name] = value
        return value
