"""Shapes checked while tests run: beartype on what jaxtyping annotates, and on nothing else."""

from collections.abc import Callable
from typing import Any, get_args

from beartype import BeartypeConf, beartype
from jaxtyping import AbstractArray

_checked = beartype(conf=BeartypeConf(is_pep484_tower=True))


def _has_shape(hint: Any) -> bool:
    alone = isinstance(hint, type) and not get_args(hint) and issubclass(hint, AbstractArray)
    return alone or any(_has_shape(part) for part in get_args(hint))


def checked(function: Callable[..., Any]) -> Callable[..., Any]:
    """Check the arrays that go in and come out; mypy has looked at all other annotations already."""
    hints = getattr(function, "__annotations__", {})
    shapes = {name: hint for name, hint in hints.items() if _has_shape(hint)}
    if not shapes:
        return function
    function.__annotations__ = shapes
    wrapped = _checked(function)
    function.__annotations__ = wrapped.__annotations__ = hints
    return wrapped
