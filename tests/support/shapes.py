"""Shapes checked while tests run: beartype on what jaxtyping annotates, and on nothing else."""

from collections.abc import Callable
from typing import Any, get_args

import numpy as np
from beartype import BeartypeConf, beartype
from jaxtyping import AbstractArray

_checked = beartype(conf=BeartypeConf(is_pep484_tower=True))


def _has_shape(hint: Any) -> bool:
    alone = isinstance(hint, type) and not get_args(hint) and issubclass(hint, AbstractArray)
    return alone or any(_has_shape(part) for part in get_args(hint))


def _as_numpy_has_it(hint: Any) -> Any:
    """NumPy makes a number of its own of an array without axes, such as the sum over the only one there was."""
    axes = getattr(hint, "dim_str", "-").split()
    return hint | np.generic if all(axis.startswith("*") for axis in axes) else hint


def checked(function: Callable[..., Any]) -> Callable[..., Any]:
    """Check the arrays that go in and come out; mypy has looked at all other annotations already."""
    hints = getattr(function, "__annotations__", {})
    shapes = {name: _as_numpy_has_it(hint) for name, hint in hints.items() if _has_shape(hint)}
    if not shapes:
        return function
    function.__annotations__ = shapes
    wrapped = _checked(function)
    function.__annotations__ = wrapped.__annotations__ = hints
    return wrapped
