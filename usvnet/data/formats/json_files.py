"""JSON files of other tools: reading them, and naming the file when they are not JSON."""

import json
from pathlib import Path
from typing import Any


def read_json(path: Path) -> Any:
    """Read a JSON file.

    Raises:
        FileNotFoundError: no such file.
        ValueError: not JSON, not UTF-8, or nested too deeply.
    """
    if not path.is_file():
        raise FileNotFoundError(f"{path}: no such file")
    try:
        return json.loads(path.read_text(encoding="utf-8-sig"))
    except RecursionError:
        raise ValueError(f"{path}: not readable as JSON: nested too deeply") from None
    except ValueError as error:
        raise ValueError(f"{path}: not readable as JSON: {error}") from None
