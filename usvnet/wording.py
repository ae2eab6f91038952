"""What programs say, in a person's words."""

import re
from collections.abc import Iterable
from difflib import get_close_matches

UNFIT = re.compile(
    r'Parser key "(?P<key>[\w.]+)": (?:Expected an? (?P<one>.+?)\. Got value: '
    r"|Does not validate against any of the Union subtypes Subtypes: \[(?P<some>.+?)(?:, NoneType)?\] Errors: .*"
    r"Given value: )(?P<got>.*)"
)
"""How jsonargparse says that a value is not of its type."""
UNKNOWN = re.compile(
    r"unrecognized arguments: --(?P<option>[\w.-]+)|Group '(?P<group>[\w.]+)' does not accept option '(?P<part>[\w.]+)'"
    r"|Option '(?P<key>[\w.]+)' is not accepted"
)
"""How it says that there is no such key."""
KINDS = {"int": "a whole number", "float": "a number", "bool": "true or false"}


def counted(count: int, noun: str, plural: str | None = None) -> str:
    """``1 frame``, ``2 frames``; the plural is the noun with an s where none is given."""
    return f"{count} {noun if count == 1 else plural or f'{noun}s'}"


def in_plain_words(message: str, space: str = "_") -> str:
    """Say in a person's words what jsonargparse says in Python's; what is not known stays as it is.

    Args:
        message: its complaint of a value.
        space: what stands between the words of an option's name.
    """
    message = re.sub(r"<class '(?:\w+\.)*(\w+)'>", r"\1", " ".join(message.split()))
    unfit = UNFIT.fullmatch(message)
    if unfit is None:
        return message
    expected = unfit["one"] or unfit["some"]
    if choices := re.fullmatch(r"(?:typing\.)?Literal\[(.*)\]", expected):
        expected = f"one of {choices[1].replace(chr(39), '')}"
    return f"--{unfit['key'].replace('_', space)}: got {unfit['got']}, expected {KINDS.get(expected, expected)}"


def did_you_mean(message: str, options: Iterable[str], space: str = "_") -> str:
    """What jsonargparse says, with the nearest option beside one that it does not know.

    Args:
        message: its complaint.
        options: all names that there are, as keys of a configuration.
        space: what stands between the words of an option's name.
    """
    unknown = UNKNOWN.match(message)
    if unknown is None:
        return message
    name = unknown["option"] or unknown["key"] or f"{unknown['group']}.{unknown['part']}"
    near = get_close_matches(name, [option.replace("_", space) for option in options], n=1, cutoff=0.7)
    dashes = "--" if unknown["option"] else ""
    return f"{message}, did you mean {dashes}{near[0]}?" if near else message
