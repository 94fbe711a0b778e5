"""A CasADi function for a block of rows at once: each of its elementary operations is done on a column of numbers.

CasADi's virtual machine walks the whole program for every row, at 5 to 7 nanoseconds an operation. Here the same
operations in the same order are written on matrix symbols, so that the machine walks the program once a block and the
inner loop runs over rows: some 0.5 nanoseconds an operation and row, with the same digits. What depends on shared
arguments alone is computed once a block.
"""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager

import casadi as ca

BEYOND = {ca.OP_CALL, ca.OP_PARAMETER}  # what stands for more than one number from one or two


def columns(function: ca.Function, shared: Sequence[bool], rows: int) -> ca.Function | None:
    """The function of scalars for so many rows; None where it is more than arithmetic, as calls of others are.

    Arguments that are `shared` come as one column of their elements, others as a matrix, a row of it for every row;
    outputs are matrices of a row for every row, elements columns first.
    """
    if any(function.instruction_id(k) in BEYOND for k in range(function.n_instructions())):
        return None
    inputs = [
        ca.MX.sym(function.name_in(i), *((function.numel_in(i), 1) if one else (rows, function.numel_in(i))))
        for i, one in enumerate(shared)
    ]
    with _as_written():
        columns_in = [ca.vertsplit(a) if one else ca.horzsplit(a) for a, one in zip(inputs, shared, strict=True)]
        columns_out = _played(function, columns_in)
        out = [ca.horzcat(*(_column(value, rows) for value in outputs)) for outputs in columns_out]
    return ca.Function(function.name(), inputs, out, function.name_in(), function.name_out())


def _played(function: ca.Function, columns_in: list[list[ca.MX]]) -> list[list[ca.MX]]:
    """The elements of every output, by the operations in their order."""
    out = [[ca.MX(0.0)] * function.numel_out(i) for i in range(function.n_out())]
    values = [ca.MX(0.0)] * function.sz_w()
    for k in range(function.n_instructions()):
        code, inputs, to = function.instruction_id(k), function.instruction_input(k), function.instruction_output(k)
        if code == ca.OP_INPUT:
            values[to[0]] = columns_in[inputs[0]][inputs[1]]
        elif code == ca.OP_OUTPUT:
            out[to[0]][to[1]] = values[inputs[0]]
        elif code == ca.OP_CONST:
            values[to[0]] = ca.MX(function.instruction_constant(k))
        elif len(inputs) == 1:
            values[to[0]] = ca.MX.unary(code, values[inputs[0]])
        else:
            values[to[0]] = ca.MX.binary(code, values[inputs[0]], values[inputs[1]])
    return out


@contextmanager
def _as_written() -> Iterator[None]:
    """CasADi rewrites matrix expressions, as x - x to 0, which changes last digits: not here."""
    before = ca.GlobalOptions.getSimplificationOnTheFly()
    ca.GlobalOptions.setSimplificationOnTheFly(False)
    try:
        yield
    finally:
        ca.GlobalOptions.setSimplificationOnTheFly(before)


def _column(value: ca.MX, rows: int) -> ca.MX:
    """A column of so many rows; a number, which depends on shared arguments alone, stands in each."""
    return ca.densify(value) if value.shape[0] == rows else ca.repmat(ca.densify(value), rows, 1)
