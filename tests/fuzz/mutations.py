"""Spoiling files that were sound, by bytes, by words and by values, and what a reader may do with the result."""

import copy
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from hypothesis import HealthCheck, settings
from hypothesis import strategies as st

DEADLINE_MS = 60_000
"""A reader that takes longer hangs; far above what one takes on a busy machine."""
WORDS = [
    *("", " ", "0", "-1", "2", "1e400", "-1e308", "nan", "inf", "0x10", "9" * 400, "9" * 5000, "1_000", "True", "None"),
    *("bow", "../x", "/", "a\x00b", "\ufeff", "\u0660", "\U0001f6a4", '"', "'", "[" * 3000, "{", "}", ":", "*a", "&a"),
    *("!!int ''", "2001-13-99", "!!timestamp x", "=", "<<", "\r", "\n", ",", ";", "\t", "%YAML:1.0"),
    *("---", "#", "é" * 200),
]  # fmt: skip
VALUES: list[Any] = [
    *(None, True, -1, 0, 1, 3, 1e308, -1e308, 10**400, float("nan"), float("inf"), "", "bow", "1", "\x00", "x" * 300),
    *([], {}, [1], [[]], {"a": 1}, [None], [["a"]], {"data": []}, ["hidden"]),
]


def quick(examples: int) -> Callable[..., Any]:
    """Hypothesis settings: the same few examples at every run."""
    return settings(
        max_examples=examples,
        deadline=DEADLINE_MS,
        derandomize=True,
        database=None,
        suppress_health_check=list(HealthCheck),
    )


EXAMPLES = [pytest.param(25, id="few"), pytest.param(2000, id="many", marks=pytest.mark.slow)]
"""How many files each reader is given: few always, many with ``pytest -m slow``."""


@st.composite
def spoilt_bytes(draw: st.DrawFn, sound: bytes) -> bytes:
    """Change, delete, repeat or insert bytes, once or a few times."""
    data = bytearray(sound)
    for _ in range(draw(st.integers(1, 4))):
        start = draw(st.integers(0, len(data)))
        end = min(len(data), start + draw(st.integers(0, 40)))
        match draw(st.sampled_from(["change", "delete", "repeat", "insert", "cut"])):
            case "change" if start < len(data):
                data[start] = draw(st.integers(0, 255))
            case "delete":
                del data[start:end]
            case "repeat":
                data[start:start] = data[start:end] * draw(st.integers(1, 3))
            case "insert":
                data[start:start] = draw(st.binary(max_size=8))
            case "cut":
                del data[start:]
    return bytes(data)


@st.composite
def spoilt_words(draw: st.DrawFn, sound: str, separators: str = " ,:\n[]") -> str:
    """Put odd words in the place of some of a text's words."""
    words, word = [], ""
    for letter in sound:
        if letter in separators:
            words += [word, letter]
            word = ""
        else:
            word += letter
    words.append(word)
    for _ in range(draw(st.integers(1, 3))):
        words[draw(st.integers(0, len(words) - 1))] = draw(st.sampled_from(WORDS))
    return "".join(words)


@st.composite
def spoilt_values(draw: st.DrawFn, sound: Any) -> Any:
    """Put odd values in the place of some of a tree's nodes, or leave nodes out."""
    tree = copy.deepcopy(sound)
    for _ in range(draw(st.integers(1, 3))):
        node, last = tree, None
        while isinstance(node, dict | list) and node:
            key = draw(st.sampled_from(sorted(node, key=str) if isinstance(node, dict) else range(len(node))))
            last = (node, key)
            if draw(st.integers(0, 3)) == 0:
                break
            node = node[key]
        if last is None:
            continue
        parent, key = last
        if draw(st.booleans()):
            parent[key] = copy.deepcopy(draw(st.sampled_from(VALUES)))  # a later step may change it
        else:
            del parent[key]
    return tree


def spoilt_text(sound: str) -> st.SearchStrategy[bytes]:
    """A text file spoilt by bytes or by words."""
    return st.one_of(spoilt_bytes(sound.encode()), spoilt_words(sound).map(lambda text: text.encode(errors="replace")))


def spoilt_json(sound: Any) -> st.SearchStrategy[bytes]:
    """A JSON file spoilt by bytes, by words or by values."""
    return st.one_of(spoilt_text(json.dumps(sound)), spoilt_values(sound).map(lambda tree: json.dumps(tree).encode()))


def read_or_refused(read: Callable[[], Any], *places: Path) -> Any:
    """What a reader gives; None where it refuses in a sentence that names one of the ``places``.

    Any error but ValueError and OSError fails the test, as does one of these that Python wrote without a place.
    """
    try:
        return read()
    except (ValueError, OSError) as error:
        refusal = error
    sentence = " ".join(str(refusal).split())
    assert any(str(place) in sentence for place in places), f"names no file: {type(refusal).__name__}: {sentence}"
    return None
