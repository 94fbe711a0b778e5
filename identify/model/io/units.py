"""A key ends in its unit: what that means for the field that it describes, and what the field is by default.

`travel_mm` describes `travel` [mm], `max_tilt_deg` describes `max_tilt` [rad]. A key that is the field's own name holds
its value as it is; a field whose key has another name says so in its metadata (`key`). Defaults stand in the
dataclasses of the model, names of keys and limits in the schema, once each.
"""

from dataclasses import fields
from typing import Any, TypeVar, get_args

import numpy as np
from pydantic import BaseModel

from identify.model.cell import DEG

UNITS = {"_mm_s": 1.0, "_deg_s": DEG, "_mm": 1.0, "_deg": DEG, "_kg": 1.0, "_c": 1.0}
DIGITS = 12  # to which a value in degrees is rounded, so that 50 stays 50

Described = TypeVar("Described")


def field_of(cls: type, key: str) -> tuple[str, float]:
    """The field of a dataclass that a key describes, and the factor from the key's unit to that of the field."""
    if key in {field.name for field in fields(cls)}:
        return key, 1.0
    named = {field.metadata.get("key"): field.name for field in fields(cls)}
    ending = next(ending for ending in UNITS if key.endswith(ending))
    return named.get(key, key.removesuffix(ending)), UNITS[ending]


def usual(cls: type, key: str) -> Any:
    """The default of the field that a key describes, in the unit of the key."""
    name, factor = field_of(cls, key)
    return outside(next(field.default for field in fields(cls) if field.name == name), factor)


def described(cls: type[Described], entry: BaseModel, default: Described | None = None) -> Described:
    """What an entry of a file describes, every number in the unit of the inside; `default` says what it leaves out."""
    kinds = {field.name: field.type for field in fields(cls)}  # type: ignore[arg-type]
    places = {key: field_of(cls, key) for key in type(entry).model_fields}
    return cls(
        **{
            name: getattr(default, name)
            if default is not None and getattr(entry, key) is None
            else _inside(getattr(entry, key), factor, _is_array(kinds[name]))
            for key, (name, factor) in places.items()
        }
    )


def _is_array(kind: Any) -> bool:
    return any(hasattr(some, "array_type") for some in (kind, *get_args(kind)))


def entry_of(thing: Any, model: type[BaseModel]) -> dict[str, Any]:
    """The inverse of `described`: the keys of a model and their values."""
    places = {key: field_of(type(thing), key) for key in model.model_fields}
    return {key: outside(getattr(thing, name), factor) for key, (name, factor) in places.items()}


def _inside(value: Any, factor: float, array: bool) -> Any:
    if array:
        return np.array(value, dtype=float) * factor
    if isinstance(value, tuple):
        return tuple(_inside(part, factor, False) for part in value)
    return value * factor if isinstance(value, float) else value


def outside(value: Any, factor: float) -> Any:
    """A value of the inside in the unit of a file."""
    if isinstance(value, np.ndarray):
        return (value / factor).round(DIGITS).tolist()
    if isinstance(value, tuple):
        return tuple(outside(part, factor) for part in value)
    return value if factor == 1.0 or not isinstance(value, float) else round(value / factor, DIGITS)
