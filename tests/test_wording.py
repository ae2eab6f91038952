"""Numbers and the nouns that they count."""

import pytest

from usvnet.wording import counted, did_you_mean, in_plain_words


@pytest.mark.parametrize(
    ("words", "told"),
    [
        ((0, "frame"), "0 frames"),
        ((1, "frame"), "1 frame"),
        ((2, "frame"), "2 frames"),
        ((1, "frame of the stream", "frames of the stream"), "1 frame of the stream"),
        ((12, "frame of the stream", "frames of the stream"), "12 frames of the stream"),
    ],
)
def test_one_is_not_many(words, told):
    assert counted(*words) == told


UNION = """Parser key "max_frames":
  Does not validate against any of the Union subtypes
  Subtypes: [<class 'int'>, <class 'NoneType'>]
  Errors:
    - Expected a <class 'int'>
    - Expected a <class 'NoneType'>
  Given value type: <class 'str'>
  Given value: many"""


@pytest.mark.parametrize(
    ("said", "told"),
    [
        (
            "Parser key \"square_mm\": Expected a <class 'float'>. Got value: wide",
            "--square-mm: got wide, expected a number",
        ),
        (UNION, "--max-frames: got many, expected a whole number"),
        (
            "Parser key \"save\": Expected a typing.Literal['auto', 'none']. Got value: film",
            "--save: got film, expected one of auto, none",
        ),
        ("unrecognized arguments:\n--fly", "unrecognized arguments: --fly"),
    ],
)
def test_complaints_are_in_plain_words(said, told):
    assert in_plain_words(said, "-") == told
    assert in_plain_words(said) == told.replace("square-mm", "square_mm").replace("max-frames", "max_frames")


@pytest.mark.parametrize(
    ("said", "near"),
    [
        ("unrecognized arguments: --data.imagesize 3", "--data.image_size"),
        ("Group 'model' does not accept option 'varient'", "model.variant"),
        ("Option 'modle.variant' is not accepted", "model.variant"),
        ("unrecognized arguments: --fly", None),
        ("--data.image_size: got wide, expected a whole number", None),
    ],
)
def test_the_nearest_option_is_named_where_there_is_one(said, near):
    told = did_you_mean(said, ["model.variant", "data.image_size", "data.root"])
    assert told == (said if near is None else f"{said}, did you mean {near}?")
