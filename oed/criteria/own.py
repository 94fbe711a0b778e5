"""Criteria of one's own: defined by a Python file, put into the table under their names."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from identify.model.files import InputError, read_text
from oed.criteria.criteria import CRITERIA
from oed.criteria.criterion import Criterion

STEP = 1e-5  # of the central differences that a slope is compared with, as a share of the information
ALIKE = 1e-4  # how well it agrees with them, as a share of the slope
STRATEGIES = "even", "random", "sequential"
PUBLISHED = frozenset({*CRITERIA, *STRATEGIES})  # names that are taken


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


def check(criterion: Criterion, parameters: int) -> None:
    """Raise ValueError if degree or slope of a criterion of one's own do not belong to its value.

    A bound that rests on them would be that of another criterion. Both are compared with differences of the value at
    an information drawn at random; the criteria of this package are held against theirs by tests.
    """
    if type(criterion).__module__.startswith(str(__package__)):
        return
    rng = np.random.default_rng(0)
    X, D = rng.standard_normal((2 * parameters, parameters)), rng.standard_normal((parameters, parameters))
    M, D = X.T @ X, D + D.T
    grown = float(criterion.power(criterion.value(2 * M)) - criterion.power(criterion.value(M)))
    if criterion.degree and abs(grown - np.log(2)) > ALIKE:
        raise ValueError(
            f"{criterion.name}: twice the information makes the value {np.exp(grown * criterion.degree):.4g} times as "
            f"large, and by its degree, {criterion.degree:g}, {2**criterion.degree:.4g} times; correct one of them"
        )
    D *= STEP * np.linalg.norm(M) / np.linalg.norm(D)
    slope, change = criterion.slope(M), (criterion.smooth(M + D) - criterion.smooth(M - D)) / 2
    if abs(change - np.trace(slope @ D)) > ALIKE * np.linalg.norm(slope) * np.linalg.norm(D):
        raise ValueError(
            f"{criterion.name}: `slope` is not the gradient of `smooth`, the logarithm of phi: by it a small change of "
            f"the information changes that by {np.trace(slope @ D):.4g}, by differences {change:.4g}; correct it"
        )
