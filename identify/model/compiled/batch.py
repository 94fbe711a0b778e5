"""One compiled CasADi function evaluated at many points at once, NumPy arrays in and out."""

from collections import Counter
from typing import Any, cast

import casadi as ca
import numpy as np

from identify.model.compiled.vectorized import columns

CHUNK = 2048  # rows that CasADi's virtual machine walks in one call, so that memory stays bounded
BLOCKS = 64, 128, 256  # rows of the functions that work on whole columns; their values stay in the cache
FEWEST = 12  # rows from which the smallest of them is faster than the virtual machine
OWN, AGAIN = 4, 20  # numbers of rows that get a block of their own each, after so many calls, if it holds them all
WORTH = 2000  # rows after which the ten milliseconds that it takes to write these functions come back


class Mapped:
    """A CasADi function applied to rows of arrays, shapes checked, without a Python loop over rows."""

    def __init__(self, function: ca.Function) -> None:
        self.function = function
        self.shapes = [function.size_out(i) for i in range(function.n_out())]
        self.names = function.name_in()
        self.sizes = [function.numel_in(i) for i in range(function.n_in())]
        self._maps: dict[int, ca.Function] = {}
        self._blocks: dict[tuple[int, tuple[bool, ...]], ca.Function | None] = {}
        self._done = 0
        self._calls: Counter[int] = Counter()
        self._own: set[int] = set()

    def __call__(self, *arguments: np.ndarray) -> tuple[np.ndarray, ...]:
        """Outputs of every row; an argument without a row axis is shared by all rows.

        A vector output comes as (rows, size), a scalar as (rows,), a matrix as (rows, height, width).
        """
        rows = self._rows(arguments)
        out = [np.empty((width * height, rows)) for height, width in self.shapes]
        self._done += rows
        if rows < FEWEST or self._done < WORTH or not self._in_blocks(rows, arguments, out):
            self._row_by_row(rows, arguments, out)
        return tuple(_shaped(o, *shape) for o, shape in zip(out, self.shapes, strict=True))

    def _rows(self, arguments: tuple[np.ndarray, ...]) -> int:
        name = self.function.name()
        if len(arguments) != len(self.names):
            raise ValueError(f"{name}: {len(arguments)} arguments, expected {', '.join(self.names)}")
        for a, of, size in zip(arguments, self.names, self.sizes, strict=True):
            if a.ndim not in (1, 2) or a.shape[-1] != size:
                raise ValueError(f"{name}: {of} has shape {a.shape}, expected (rows, {size})")
        counts = {a.shape[0] for a in arguments if a.ndim == 2}
        if len(counts) > 1:
            raise ValueError(f"{name}: arguments have {sorted(counts)} rows, expected one number")
        return counts.pop() if counts else 1

    def _in_blocks(self, rows: int, arguments: tuple[np.ndarray, ...], out: list[np.ndarray]) -> bool:
        """Fill `out` a block of rows at a time; False where the function cannot be written so."""
        shared = tuple(a.ndim < 2 for a in arguments)
        start = 0
        sizes = sorted({*BLOCKS, rows}) if self._deserves(rows) else BLOCKS
        while start < rows:
            size = next((size for size in sizes if size >= rows - start), sizes[-1])
            block = self._block(size, shared)
            if block is None:
                return False
            part = slice(start, min(start + size, rows))
            # kept in lists: CasADi holds bare pointers to them
            inputs = [_whole(a if one else _padded(a[part], size)) for a, one in zip(arguments, shared, strict=True)]
            outputs = [np.empty((width * height, size)) for height, width in self.shapes]
            _evaluate(block, inputs, outputs)
            for o, of_block in zip(out, outputs, strict=True):
                o[:, part] = of_block[:, : part.stop - start]
            start = part.stop
        return True

    def _deserves(self, rows: int) -> bool:
        """Whether a number of rows has a block of its own: some that are asked for again and again."""
        if rows not in self._own and rows <= 2 * BLOCKS[-1] and len(self._own) < OWN:
            self._calls[rows] += 1
            if self._calls[rows] == AGAIN:
                self._own.add(rows)
        return rows in self._own

    def _block(self, size: int, shared: tuple[bool, ...]) -> ca.Function | None:
        if (size, shared) not in self._blocks:
            self._blocks[size, shared] = columns(self.function, shared, size)
        return self._blocks[size, shared]

    def _row_by_row(self, rows: int, arguments: tuple[np.ndarray, ...], out: list[np.ndarray]) -> None:
        """Fill `out` by CasADi's virtual machine."""
        for start in range(0, rows, CHUNK):
            part = slice(start, min(start + CHUNK, rows))
            size = part.stop - start
            if size not in self._maps:
                self._maps[size] = self.function.map(size)
            inputs = [_whole(np.broadcast_to(a if a.ndim < 2 else a[part], (size, a.shape[-1]))) for a in arguments]
            outputs = [np.empty((size, len(o))) for o in out]
            _evaluate(self._maps[size], inputs, outputs)
            for o, of_rows in zip(out, outputs, strict=True):
                o[:, part] = of_rows.T


def _whole(a: np.ndarray) -> np.ndarray:
    return np.ascontiguousarray(a, dtype=float)


def _padded(part: np.ndarray, size: int) -> np.ndarray:
    """Columns of so many rows, the last row repeated to fill them."""
    values = np.empty((part.shape[1], size))
    values[:, : len(part)] = part.T
    values[:, len(part) :] = part[-1][:, None]
    return values


def _evaluate(function: ca.Function, arguments: list[np.ndarray], out: list[np.ndarray]) -> None:
    """Evaluate on contiguous arrays, in place."""
    buffer, evaluate = function.buffer()
    buffer = cast(Any, buffer)  # the stubs hide that one memoryview is enough
    for i, a in enumerate(arguments):
        buffer.set_arg(i, a.data)
    for i, o in enumerate(out):
        buffer.set_res(i, o.data)
    evaluate()
    if buffer.ret():
        raise ArithmeticError(f"{function.name()}: evaluation failed with status {buffer.ret()}")


def _shaped(out: np.ndarray, height: int, width: int) -> np.ndarray:
    """Elements, columns of a matrix one after the other, a row each, as the reader wants them: rows first."""
    if width == 1:
        return out[0] if height == 1 else out.T
    return np.ascontiguousarray(out.T).reshape(-1, width, height).transpose(0, 2, 1)


def compiled(name: str, inputs: dict[str, Any], outputs: dict[str, Any]) -> Mapped:
    """Compile expressions once, with named inputs and outputs."""
    names = list(outputs)
    expressions = ca.cse([ca.densify(outputs[key]) for key in names])
    return Mapped(ca.Function(name, list(inputs.values()), expressions, list(inputs), names))
