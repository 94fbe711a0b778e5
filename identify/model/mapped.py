"""One compiled CasADi function evaluated at many points at once, NumPy arrays in and out."""

from functools import cached_property
from typing import Any, cast

import casadi as ca
import numpy as np

from identify.model.tape import FEWEST, Tape

CHUNK = 2048  # rows that CasADi evaluates in one call, so that memory stays bounded whatever the number of touches


class Mapped:
    """A CasADi function applied to rows of arrays, shapes checked, without a Python loop over rows."""

    def __init__(self, function: ca.Function) -> None:
        self.function = function
        self.shapes = [function.size_out(i) for i in range(function.n_out())]
        self._maps: dict[int, ca.Function] = {}

    @cached_property
    def _tape(self) -> Tape:
        return Tape(self.function)

    def __call__(self, *arguments: np.ndarray) -> tuple[np.ndarray, ...]:
        """Outputs of every row; an argument without a row axis is shared by all rows.

        A vector output comes as (rows, size), a scalar as (rows,), a matrix as (rows, height, width).
        """
        rows = self._rows(arguments)
        out = [np.empty((rows, width, height)) for height, width in self.shapes]
        if rows >= FEWEST and self._tape.playable:
            self._tape.play(arguments, [o.reshape(rows, -1) for o in out])
            return tuple(_squeezed(o) for o in out)
        for start in range(0, rows, CHUNK):
            size = min(CHUNK, rows - start)
            self._evaluate(
                size,
                [a if a.ndim < 2 else a[start : start + size] for a in arguments],
                [o[start : start + size] for o in out],
            )
        return tuple(_squeezed(o) for o in out)

    def _rows(self, arguments: tuple[np.ndarray, ...]) -> int:
        names = self.function.name_in()
        if len(arguments) != len(names):
            raise ValueError(f"{self.function.name()}: {len(arguments)} arguments, expected {', '.join(names)}")
        counts = {a.shape[0] for a in arguments if a.ndim == 2}
        for name, a, i in zip(names, arguments, range(len(names)), strict=True):
            if a.ndim not in (1, 2) or a.shape[-1] != self.function.numel_in(i):
                raise ValueError(
                    f"{self.function.name()}: {name} has shape {a.shape}, expected (rows, {self.function.numel_in(i)})"
                )
        if len(counts) > 1:
            raise ValueError(f"{self.function.name()}: arguments have {sorted(counts)} rows, expected one number")
        return counts.pop() if counts else 1

    def _evaluate(self, size: int, arguments: list[np.ndarray], out: list[np.ndarray]) -> None:
        if size not in self._maps:
            self._maps[size] = self.function.map(size)
        buffer, evaluate = self._maps[size].buffer()
        buffer = cast(Any, buffer)  # the stubs hide that one memoryview is enough
        # kept in a list: CasADi holds bare pointers to them
        held: list[np.ndarray] = [
            np.ascontiguousarray(np.broadcast_to(a, (size, a.shape[-1])), dtype=float) for a in arguments
        ]
        for i, a in enumerate(held):
            buffer.set_arg(i, a.data)
        for i, o in enumerate(out):
            buffer.set_res(i, o.data)
        evaluate()
        if buffer.ret():
            raise ArithmeticError(f"{self.function.name()}: evaluation failed with status {buffer.ret()}")


def _squeezed(out: np.ndarray) -> np.ndarray:
    """CasADi stores columns first: (rows, width, height) in memory is (rows, height, width) to the reader."""
    _, width, height = out.shape
    if width == 1:
        return out[:, 0, 0] if height == 1 else out[:, 0, :]
    return out[:, :, 0] if height == 1 else out.transpose(0, 2, 1)


def compiled(name: str, inputs: dict[str, Any], outputs: dict[str, Any]) -> Mapped:
    """Compile expressions once, with named inputs and outputs."""
    names = list(outputs)
    expressions = ca.cse([ca.densify(outputs[key]) for key in names])
    return Mapped(ca.Function(name, list(inputs.values()), expressions, list(inputs), names))
