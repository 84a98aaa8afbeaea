"""Small frozen dataclasses as attributes of a group: numbers and words plainly, the rest as JSON."""

from __future__ import annotations

import json
import types
import typing
from collections.abc import Mapping
from dataclasses import MISSING, asdict, fields, is_dataclass
from typing import Any, TypeVar

import numpy as np

from cmm_align.errors import MalformedInputError
from cmm_align.io.hdf5_library import h5py
from cmm_align.io.safe_hdf5 import attribute, find, is_older, json_attribute, where_of

T = TypeVar("T")


def write_record(group: h5py.Group, record: Any) -> None:
    """Write the fields of a dataclass as attributes of `group`; None is left out."""
    for field in fields(record):
        value = getattr(record, field.name)
        if value is None:
            continue
        if isinstance(value, np.generic):
            value = value.item()
        if isinstance(value, bool | int | float | str):
            group.attrs[field.name] = value
        else:
            group.attrs[field.name] = json.dumps(_plain(value), ensure_ascii=False)


def read_record(file: h5py.File, path: str, kind: type[T]) -> T:
    """Return the dataclass that `write_record` wrote to the group at `path`.

    Raises
    ------
    MalformedInputError
        If a field is missing (one without a default, in files of older versions) or of another type.
    """
    owner = find(file, path)
    if owner is None:
        raise MalformedInputError("the group is missing", where=where_of(file, path))
    values: dict[str, Any] = {}
    hints = typing.get_type_hints(kind)
    for field in fields(kind):  # type: ignore[arg-type]
        name = field.name
        inner, optional = _without_none(hints[name])
        has_default = field.default is not MISSING or field.default_factory is not MISSING
        if name not in owner.attrs and has_default and (optional or is_older(file)):
            continue
        if name not in owner.attrs and optional:
            values[name] = None
        elif inner in {bool, int, float, str}:
            values[name] = attribute(file, path, name, inner)
        else:
            where = where_of(file, f"{path}/@{name}")
            values[name] = typed(json_attribute(file, path, name), inner, where)
    return kind(**values)


def typed(value: Any, hint: Any, where: str) -> Any:
    """Return a JSON value as the type `hint` says: number, text, tuple, mapping or dataclass.

    Raises
    ------
    MalformedInputError
        If it is of another type.
    """
    hint, optional = _without_none(hint)
    if optional and value is None:
        return None
    origin, args = typing.get_origin(hint), typing.get_args(hint)
    if hint is float and isinstance(value, int | float) and not isinstance(value, bool):
        return float(value)
    whole = hint in {int, str} and not isinstance(value, bool)
    if (whole or hint is bool) and isinstance(value, hint):
        return value
    if origin is tuple and isinstance(value, list):
        inner = [args[0]] * len(value) if args[-1] is Ellipsis else list(args)
        if len(inner) == len(value):
            return tuple(typed(v, h, where) for v, h in zip(value, inner, strict=True))
    if origin is Mapping and isinstance(value, dict):
        return {str(k): typed(v, args[1], where) for k, v in value.items()}
    if isinstance(hint, type) and is_dataclass(hint) and isinstance(value, dict):
        hints = typing.get_type_hints(hint)
        if set(hints) == set(value):
            return hint(**{k: typed(value[k], h, where) for k, h in hints.items()})
    raise MalformedInputError(f"{value!r}", where=where, expected=f"a value of type {hint}")


def _plain(value: Any) -> Any:
    if isinstance(value, Mapping):
        return {str(k): _plain(v) for k, v in value.items()}
    if isinstance(value, tuple | list):
        return [_plain(v) for v in value]
    if is_dataclass(value) and not isinstance(value, type):
        return asdict(value)
    return value.item() if hasattr(value, "item") else value


def _without_none(hint: Any) -> tuple[Any, bool]:
    if isinstance(hint, types.UnionType) and types.NoneType in typing.get_args(hint):
        rest = [a for a in typing.get_args(hint) if a is not types.NoneType]
        return rest[0], True
    return hint, False
