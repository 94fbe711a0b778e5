"""What a criterion is: all that relaxation, exchange, refinement and certificates ask of it.

Each criterion is, up to a power, a function phi of the information M that is homogeneous of degree one. Where phi is
concave, a matrix S that supports it at M0 gives phi(M) <= tr(S M) for every M: that is the whole certificate (Kiefer
and Wolfowitz 1960; Pukelsheim 1993).
"""

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import ClassVar, Literal, Self

import numpy as np
from jaxtyping import Float

from oed.criteria.first_order_swaps import FirstOrderSwaps
from oed.criteria.swaps import Precision, Square, Swaps

Batch = Float[np.ndarray, "*batch"]
Squares = Float[np.ndarray, "*batch p p"]
Rows = Float[np.ndarray, "k p"]
SAMPLES = 16  # points of a neighbourhood over which a gradient is averaged
STEP = 1e-5  # of the finite differences there, relative


@dataclass(frozen=True, eq=False)
class Criterion(ABC):
    """One way to score the information of a set of touches.

    A subclass defines `raw`, `slope`, `curvature` and `in_basis`; the rest follows. `degree` says how the value grows
    when the information is scaled, as information**degree: with a positive or zero degree larger is better. `keeps`
    says what stays the same when the parameters are measured in other units or in another frame, so that rows X become
    X T and the information M becomes T' M T: "ranking", the order of all designs, as for D; "value", the value itself,
    as for V, whose zone changes along; "rotation", only if T is a rotation, as for A.
    """

    name: str
    """By which options and tables call it."""
    degree: float
    """The value grows as information**degree."""
    keeps: Literal["ranking", "value", "rotation"]
    """What other units or frames of the parameters do not change."""
    source: str
    """Author and year of the publication."""

    per_touch: ClassVar[bool] = False
    """Whether the value is that of the information of one touch."""
    certified: ClassVar[bool] = True
    """Whether phi is concave, so that `support` bounds every design."""
    needs_zone: ClassVar[bool] = False
    """Whether the poses of the weld zone are needed to score."""
    formula: ClassVar[type[Swaps]] = FirstOrderSwaps
    """What a swap of two touches changes."""
    blurs: ClassVar[tuple[float, ...]] = (0.0,)
    """Relative sizes of neighbourhoods for `blurred_slope`."""

    @property
    def larger_is_better(self) -> bool:
        """Whether a plan wants this value large."""
        return self.degree >= 0

    @property
    def meaning(self) -> str:
        """One sentence for people."""
        return (type(self).__doc__ or "").split("\n")[0]

    @abstractmethod
    def raw(self, M: Squares) -> Batch:
        """Value for the information of one touch or of all together; a batch of matrices gives a batch of values."""

    @abstractmethod
    def slope(self, M: Square) -> Square:
        """Gradient of `smooth`: a touch x raises it by x' slope x per unit of weight."""

    @abstractmethod
    def curvature(self, M: Square, X: Rows) -> Float[np.ndarray, "k k"]:
        """Minus the Hessian of `smooth` in the weights of the touches X."""

    def value(self, M: Squares, touches: int = 1) -> Batch:
        """Value for total information M of `touches` touches."""
        with np.errstate(divide="ignore", invalid="ignore"):
            return self.raw(np.asarray(M, dtype=float) / (touches if self.per_touch else 1))

    def power(self, value: Batch) -> Batch:
        """Logarithm of phi for a value; of the value itself where its degree is zero."""
        with np.errstate(divide="ignore"):
            return np.log(value) / (self.degree or 1.0)

    def log(self, M: Square) -> float:
        """Logarithm of phi; minus infinity where M is singular."""
        return float(self.power(self.value(M)))

    def phi(self, M: Square) -> float:
        """The criterion as a function of degree one in the information, larger being better."""
        return float(np.exp(self.log(M)))

    def smooth(self, M: Square) -> float:
        """`log`, or where phi has kinks the logarithm of a smooth function near it."""
        return self.log(M)

    def support(self, M: Square) -> Square:
        """An S with phi(M') <= tr(S M') for every M': the tangent of a concave function."""
        return self.phi(M) * self.slope(M)

    def on(self, zone: np.ndarray | None, parameters: int) -> Self:
        """The criterion of a problem: of the poses of a zone, if it needs them."""
        return self

    @abstractmethod
    def in_basis(self, T: Float[np.ndarray, "p q"]) -> Self:
        """The same criterion for rows X T."""

    def basis(self, T: Square) -> Square:
        """The change of parameters in which the relaxation computes, where T makes the information one."""
        return T

    def needs(self, unseen_space: Float[np.ndarray, "p u"], seen_space: Float[np.ndarray, "p s"]) -> bool:
        """Whether the value depends on directions that no row sees."""
        return True

    @property
    def relaxed(self) -> "Criterion":
        """The concave criterion whose best weights the relaxation takes: this one, if it is concave."""
        return self

    def sharpened(self) -> Iterator[Self]:
        """The functions to maximise one after the other, each nearer to phi than the one before."""
        yield self

    def swaps(self, rows: Float[np.ndarray, "pool p"], before: Square, precision: Precision = np.float32) -> Swaps:
        """What swaps among rows change, beside the information `before` them."""
        return self.formula(rows, before, self, precision)

    def blurred_slope(self, M: Square, blur: float) -> Square:
        """Gradient of `log`, averaged over a neighbourhood where it has kinks."""
        return self.slope(M)

    def logs_after(
        self, M: Square, x: Float[np.ndarray, "k p"], y: Float[np.ndarray, "k p"]
    ) -> Float[np.ndarray, " k"]:
        """`log` after each of some swaps, of a row x for a row y."""
        return self.power(self.value(M - x[:, :, None] * x[:, None, :] + y[:, :, None] * y[:, None, :]))


@dataclass(frozen=True, eq=False)
class FunctionCriterion(Criterion):
    """A published function of numbers that the information has: its singular values, or variances."""

    function: Callable[[np.ndarray], np.ndarray]

    blurs: ClassVar[tuple[float, ...]] = (0.05, 0.2, 0.6)

    @property
    def meaning(self) -> str:
        """One sentence for people."""
        return (self.function.__doc__ or "").split("\n")[0]

    @abstractmethod
    def numbers(self, M: Squares) -> Float[np.ndarray, "*batch k"]:
        """What the value is a function of."""

    @abstractmethod
    def at(self, numbers: Float[np.ndarray, "*batch k"]) -> Batch:
        """Value for such numbers."""

    @abstractmethod
    def along(self, M: Square, rates: Callable[[Float[np.ndarray, " k"]], Float[np.ndarray, " k"]]) -> Square:
        """Gradient of a function by M, from its derivatives by the logarithms of the numbers."""

    def raw(self, M: Squares) -> Batch:
        """The published function."""
        return self.at(self.numbers(M))

    def blurred_slope(self, M: Square, blur: float) -> Square:
        """Gradient of `log`, averaged over a neighbourhood of the numbers."""
        return self.along(M, lambda numbers: self._blurred(numbers, blur))

    def _blurred(self, numbers: Float[np.ndarray, " k"], blur: float) -> Float[np.ndarray, " k"]:
        """Derivatives of `log` by the logarithms of the numbers, by finite differences.

        Those of a function of degree one add up to one, so rounding is taken out of them.
        """
        total, bump = np.zeros(len(numbers)), 1 + STEP * np.eye(len(numbers))
        for point in numbers * np.exp(blur * self._draws(len(numbers))):
            total += self.power(self.at(point * bump)) - self.power(self.at(point))
        return total / (abs(total.sum()) if self.degree else STEP * SAMPLES)

    def _draws(self, k: int) -> Float[np.ndarray, "samples k"]:
        if k not in self._drawn:
            self._drawn[k] = np.random.default_rng(0).standard_normal((SAMPLES, k))
        return self._drawn[k]

    @cached_property
    def _drawn(self) -> dict[int, Float[np.ndarray, "samples k"]]:
        """Points of a neighbourhood, by the number of numbers."""
        return {}
