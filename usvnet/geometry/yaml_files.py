"""The YAML that people, ROS and OpenCV write: reading it, and naming file and key when it is not as expected."""

import math
import re
import reprlib
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import torch
import yaml
from torch import Tensor

Mapping = dict[str, Any]
LARGEST = torch.finfo(torch.float32).max


class _Loader(yaml.SafeLoader):
    """PyYAML's safe loader, which also takes OpenCV's tagged matrices as plain mappings."""


_Loader.add_multi_constructor(
    "tag:yaml.org,2002:opencv-", lambda loader, _, node: loader.construct_mapping(node, deep=True)
)


_LOADER_FAILURES = (ValueError, TypeError, AttributeError, LookupError, RecursionError)
"""What PyYAML lets through for scalars that lie about their type (month 13, ``!!int ''``) and for deep nesting."""


def read_mapping(path: Path) -> Mapping:
    """Read a YAML file whose top level is a mapping; OpenCV's FileStorage header is accepted.

    Raises:
        FileNotFoundError: no such file.
        ValueError: not YAML, or no mapping.
    """
    if not path.is_file():
        raise FileNotFoundError(f"{path}: no such file")
    try:
        text = re.sub(r"\A%YAML:\S*", "", path.read_text(encoding="utf-8-sig"))  # "%YAML:1.0" is no YAML directive
        content = yaml.load(text, Loader=_Loader)
    except UnicodeDecodeError as error:
        raise ValueError(f"{path}: expected a text file in UTF-8") from error
    except (yaml.YAMLError, *_LOADER_FAILURES) as error:
        reason = "nested too deeply" if isinstance(error, RecursionError) else " ".join(str(error).split())
        raise ValueError(f"{path}: not valid YAML: {reason}") from error
    return as_mapping(content, f"{path}")


def as_mapping(value: object, where: str) -> Mapping:
    """Insist on a mapping; ``where`` names the file and key in the error."""
    if not isinstance(value, dict):
        raise ValueError(f"{where}: expected a mapping of keys to values, got {short(value)}")
    return value


def require(mapping: Mapping, key: str, where: str) -> Any:
    """Value of a key that must be there."""
    if key not in mapping:
        raise ValueError(f"{where}: {key} is missing")
    return mapping[key]


def as_number(value: object, where: str) -> float:
    """Insist on a number that float32 can hold. PyYAML takes 1e-5 for text, so text that reads as a number is one."""
    if isinstance(value, (int, float, str)) and not isinstance(value, bool):
        try:
            number = float(value)
        except (ValueError, OverflowError):
            number = math.nan
        if abs(number) <= LARGEST:
            return number
    raise ValueError(f"{where}: expected a finite number, got {short(value)}")


def as_numbers(value: object, where: str) -> list[float]:
    """Insist on a list of finite numbers."""
    if not isinstance(value, list):
        raise ValueError(f"{where}: expected a list of numbers, got {short(value)}")
    return [as_number(item, where) for item in value]


def read_std(mapping: Mapping, key: str, where: str) -> float:
    """A standard deviation, 0 where the mapping has none."""
    std = as_number(mapping.get(key, 0.0), f"{where}: {key}")
    if std < 0:
        raise ValueError(f"{where}: {key}: expected a standard deviation of at least 0, got {std:g}")
    return std


def refuse_unknown(mapping: Mapping, known: Sequence[str], where: str) -> None:
    """Insist that a mapping has no keys but the ``known`` ones."""
    for key in mapping:
        if key not in known:
            raise ValueError(f"{where}: unknown key {short(key)}; expected one of {', '.join(known)}")


def decimal_text(value: Tensor, degrees: bool = False) -> str:
    """Shortest decimal number that reads back as the same scalar in its own dtype; radians can be told in degrees."""
    exact = math.degrees(float(value)) if degrees else float(value)
    number = exact
    for digits in range(1, 18):
        number = float(f"{exact:.{digits}g}")
        back = torch.tensor(math.radians(number) if degrees else number, dtype=value.dtype)
        if back == value.cpu():
            break
    text = repr(number)
    return text if "." in text else text.replace("e", ".0e")  # YAML 1.1 takes 1e-05 for text


def short(value: object) -> str:
    """Say a value of a file in at most 60 characters, however deep it is (aliases can make it endless)."""
    text = _Shortener.repr(value)
    return text if len(text) <= 60 else f"{text[:57]}..."


_Shortener = reprlib.Repr()
_Shortener.maxlevel, _Shortener.maxlist, _Shortener.maxdict, _Shortener.maxstring = 3, 8, 8, 80
