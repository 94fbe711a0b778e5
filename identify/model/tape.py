"""A CasADi function run by NumPy: one elementary operation at a time, for thousands of rows at once.

CasADi's virtual machine walks the whole program for every row, at 5 to 7 nanoseconds an operation; NumPy walks it once
for a chunk of rows, at about 1. What depends on shared arguments alone is computed once a chunk, not once a row. Below
some hundred rows NumPy's overhead of half a microsecond an operation wins nothing.
"""

from collections.abc import Callable, Sequence
from typing import Any

import casadi as ca
import numpy as np

CHUNK = 8192  # rows at a time: few enough for the values in use to stay in the cache
FEWEST = 250  # rows from which the tape is faster than CasADi's virtual machine

Operation = Callable[..., Any]
OPERATIONS: dict[int, Operation] = {
    ca.OP_ASSIGN: lambda a: a,
    ca.OP_ADD: np.add,
    ca.OP_SUB: np.subtract,
    ca.OP_MUL: np.multiply,
    ca.OP_DIV: np.divide,
    ca.OP_NEG: np.negative,
    ca.OP_TWICE: lambda a: a + a,
    ca.OP_SQ: np.square,
    ca.OP_INV: np.reciprocal,
    ca.OP_SQRT: np.sqrt,
    ca.OP_SIN: np.sin,
    ca.OP_COS: np.cos,
    ca.OP_TAN: np.tan,
    ca.OP_ASIN: np.arcsin,
    ca.OP_ACOS: np.arccos,
    ca.OP_ATAN: np.arctan,
    ca.OP_ATAN2: np.arctan2,
    ca.OP_TANH: np.tanh,
    ca.OP_EXP: np.exp,
    ca.OP_LOG: np.log,
    ca.OP_POW: np.power,
    ca.OP_CONSTPOW: np.power,
    ca.OP_FABS: np.abs,
    ca.OP_SIGN: np.sign,
    ca.OP_FMIN: np.fmin,
    ca.OP_FMAX: np.fmax,
    ca.OP_LT: lambda a, b: np.less(a, b) * 1.0,
    ca.OP_LE: lambda a, b: np.less_equal(a, b) * 1.0,
    ca.OP_EQ: lambda a, b: np.equal(a, b) * 1.0,
    ca.OP_NE: lambda a, b: np.not_equal(a, b) * 1.0,
    ca.OP_NOT: lambda a: np.equal(a, 0) * 1.0,
    ca.OP_IF_ELSE_ZERO: lambda a, b: np.where(a, b, 0.0),
}


class Tape:
    """The elementary operations of a CasADi function, in their order."""

    def __init__(self, function: ca.Function) -> None:
        self.registers = function.sz_w()
        self.outputs = [function.numel_out(i) for i in range(function.n_out())]
        count = range(function.n_instructions())
        codes = [function.instruction_id(k) for k in count]
        self.playable = all(code in OPERATIONS or code in _MOVES for code in codes)
        self._steps = [
            (
                code,
                OPERATIONS.get(code),
                tuple(function.instruction_input(k)),
                tuple(function.instruction_output(k)),
                function.instruction_constant(k) if code == ca.OP_CONST else 0.0,
            )
            for k, code in zip(count, codes, strict=True)
        ]

    def play(self, arguments: Sequence[np.ndarray], out: Sequence[np.ndarray]) -> None:
        """Fill `out`, arrays (rows, size), from arguments (rows, size), or (size,) where all rows share them."""
        rows = len(out[0])
        with np.errstate(all="ignore"):  # infinities and NaNs travel to the reader, as through CasADi
            for start in range(0, rows, CHUNK):
                part = slice(start, min(start + CHUNK, rows))
                columns = [np.ascontiguousarray(a[part].T) if a.ndim == 2 else a for a in arguments]
                self._play(columns, [o[part] for o in out])

    def _play(self, arguments: list[np.ndarray], out: list[np.ndarray]) -> None:
        values: list[Any] = [0.0] * self.registers
        for code, operation, given, to, constant in self._steps:
            if operation is not None:
                values[to[0]] = operation(*[values[i] for i in given])
            elif code == ca.OP_INPUT:
                values[to[0]] = arguments[given[0]][given[1]]
            elif code == ca.OP_OUTPUT:
                out[to[0]][:, to[1]] = values[given[0]]
            else:
                values[to[0]] = constant


_MOVES = {ca.OP_INPUT, ca.OP_OUTPUT, ca.OP_CONST}
