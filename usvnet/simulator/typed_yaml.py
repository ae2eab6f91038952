"""Filling typed, frozen dataclasses from YAML, so that every wrong key or value is one sentence that names it.

A field's type says what is expected, its :class:`Bounds` how large it may be. Types: float, int, str, bool,
Path (relative to the YAML file), Literal, :class:`Range`, another dataclass, ``tuple[X, ...]``, ``tuple[X, X, X]``,
``dict[str, X]`` and ``X | None``.
"""

import dataclasses
import math
import types
import typing
from dataclasses import MISSING, dataclass
from pathlib import Path
from typing import Any, Literal, TypeVar

import numpy as np

from usvnet.geometry.yaml_files import as_mapping, as_number, as_numbers, refuse_unknown, require

Settings = TypeVar("Settings")


@dataclass(frozen=True)
class Range:
    """Numbers from ``low`` to ``high``; in a file ``[low, high]``, or one number for both."""

    low: float
    high: float

    def __post_init__(self) -> None:
        if not self.low <= self.high:
            raise ValueError(f"expected [low, high], got [{self.low:g}, {self.high:g}]")

    def draw(self, rng: np.random.Generator) -> float:
        """Any number of the range, all alike."""
        return float(rng.uniform(self.low, self.high))

    def draw_log(self, rng: np.random.Generator) -> float:
        """Any number of a range above 0, every doubling alike."""
        return float(min(max(np.exp(rng.uniform(math.log(self.low), math.log(self.high))), self.low), self.high))

    def draw_whole(self, rng: np.random.Generator) -> int:
        """Any whole number of the range, both ends included."""
        return int(rng.integers(round(self.low), round(self.high) + 1))


@dataclass(frozen=True)
class Bounds:
    """``Annotated[float, Bounds(low, high)]``: the number, or both ends of a range, must lie between the two."""

    low: float
    high: float = math.inf


class Bounded:
    """Base of dataclasses whose numbers are held to their :class:`Bounds` when they are made."""

    def __post_init__(self) -> None:
        for name, bounds in _bounds_of(type(self)).items():
            value = getattr(self, name)
            numbers = (value.low, value.high) if isinstance(value, Range) else (value,)
            for number in numbers:
                if number is not None and not bounds.low <= number <= bounds.high:
                    low, high = bounds.low, bounds.high
                    span = f"between {low:g} and {high:g}" if high < math.inf else f"of at least {low:g}"
                    raise ValueError(f"{name}: expected a number {span}, got {number:g}")


def _bounds_of(cls: type) -> dict[str, Bounds]:
    hints = typing.get_type_hints(cls, include_extras=True)
    marks = {name: getattr(hint, "__metadata__", ()) for name, hint in hints.items()}
    return {name: mark for name, found in marks.items() for mark in found if isinstance(mark, Bounds)}


def fill(cls: type[Settings], content: object, where: str, folder: Path) -> Settings:
    """Make the dataclass ``cls`` of the mapping ``content``.

    Args:
        cls: what to fill; its fields are the keys, those without a default are required.
        content: what the file says.
        where: file and key for the messages.
        folder: what relative paths start from.

    Raises:
        ValueError: one sentence naming the key that is unknown, missing or not as expected.
    """
    mapping = as_mapping(content, where)
    fields = {field.name: field for field in dataclasses.fields(cls)}  # type: ignore[arg-type]
    refuse_unknown(mapping, tuple(fields), where)
    hints = typing.get_type_hints(cls)
    values = {}
    for name, field in fields.items():
        if name in mapping:
            values[name] = _value(hints[name], mapping[name], f"{where}: {name}", folder)
        elif field.default is MISSING and field.default_factory is MISSING:
            require(mapping, name, where)
    return _made(cls, values, where)


def _value(kind: Any, value: object, where: str, folder: Path) -> Any:
    origin, arguments = typing.get_origin(kind), typing.get_args(kind)
    if origin in (types.UnionType, typing.Union):
        wanted = [argument for argument in arguments if argument is not types.NoneType]
        return None if value is None else _value(wanted[0], value, where, folder)
    if origin is Literal:
        if value not in arguments:
            raise ValueError(f"{where}: expected one of {', '.join(arguments)}, got {value!r}")
        return value
    if origin is dict:
        mapping = as_mapping(value, where)
        keys = [_value(arguments[0], key, where, folder) for key in mapping]
        return {key: _value(arguments[1], mapping[key], f"{where}: {key}", folder) for key in keys}
    if origin is tuple:
        return _items(arguments, value, where, folder)
    if kind is Range:
        return _range(value, where)
    if kind is float:
        return as_number(value, where)
    if kind is int:
        number = as_number(value, where)
        if number != int(number):
            raise ValueError(f"{where}: expected a whole number, got {number:g}")
        return int(number)
    if kind is bool:
        if not isinstance(value, bool):
            raise ValueError(f"{where}: expected true or false, got {value!r}")
        return value
    if kind is str:
        return _text(value, where)
    if kind is Path:
        return folder / _text(value, where)
    return fill(kind, value, where, folder)


def _items(arguments: tuple[Any, ...], value: object, where: str, folder: Path) -> tuple[Any, ...]:
    if not isinstance(value, list):
        raise ValueError(f"{where}: expected a list, got {value!r}")
    if arguments[-1] is not Ellipsis and len(value) != len(arguments):
        raise ValueError(f"{where}: expected {len(arguments)} values, got {len(value)}")
    return tuple(_value(arguments[0], item, f"{where}[{i}]", folder) for i, item in enumerate(value))


def _range(value: object, where: str) -> Range:
    numbers = as_numbers(value, where) if isinstance(value, list) else [as_number(value, where)] * 2
    if len(numbers) != 2:
        raise ValueError(f"{where}: expected a number or [low, high], got {len(numbers)} numbers")
    return _made(Range, {"low": numbers[0], "high": numbers[1]}, where)


def _text(value: object, where: str) -> str:
    if not isinstance(value, str) or not value:
        raise ValueError(f"{where}: expected text, got {value!r}")
    return value


def _made(cls: type[Settings], values: dict[str, Any], where: str) -> Settings:
    """Put ``where`` before what the dataclass itself finds wrong."""
    try:
        return cls(**values)
    except ValueError as error:
        raise ValueError(f"{where}: {error}") from None
