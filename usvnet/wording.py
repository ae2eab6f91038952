"""What programs say, in a person's words."""

import re

UNFIT = re.compile(
    r'Parser key "(?P<key>[\w.]+)": (?:Expected an? (?P<one>.+?)\. Got value: '
    r"|Does not validate against any of the Union subtypes Subtypes: \[(?P<some>.+?)(?:, NoneType)?\] Errors: .*"
    r"Given value: )(?P<got>.*)"
)
"""How jsonargparse says that a value is not of its type."""
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
