"""The zip archive that ``torch.save`` writes, read with nothing but :mod:`zipfile`, and nothing of it unpacked to disk.

Entries are stored uncompressed and may not overlap, so no file asks for more memory than it has bytes.
"""

import math
import zipfile
from pathlib import Path
from types import TracebackType
from typing import NoReturn, Self

import torch
from torch import Tensor

from usvnet.pretrained.pickle_reader import MAX_BYTES, StoredTensor

DAMAGE = (zipfile.BadZipFile, EOFError, NotImplementedError, OSError, UnicodeError)
"""What :mod:`zipfile` raises on bytes that are no archive."""


class TorchArchive:
    """A file of ``torch.save``, open for reading: one folder with data.pkl and the storages ``data/0``, ``data/1``, ...

    Raises:
        FileNotFoundError: no such file.
        ValueError: the file is no such archive, or one with tricks.
    """

    def __init__(self, path: Path | str) -> None:
        self.path = Path(path)
        if not self.path.is_file():
            raise FileNotFoundError(f"{path}: no such file")
        if not zipfile.is_zipfile(path):
            self._refuse("is not a zip archive")
        try:
            self._zip = zipfile.ZipFile(path)
        except DAMAGE as error:
            raise ValueError(f"{path}: damaged zip archive: {error}") from error
        try:
            self._entries = self._checked_entries()
            if self._entries.get("byteorder") and self._read("byteorder") != b"little":
                self._refuse("was written on a big-endian machine")
        except ValueError:
            self._zip.close()
            raise

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, at: TracebackType | None) -> None:
        self._zip.close()

    def pickle(self) -> bytes:
        """The bytes of data.pkl."""
        if self._entries["data.pkl"].file_size > MAX_BYTES:
            self._refuse(f"has a data.pkl of more than {MAX_BYTES} bytes")
        return self._read("data.pkl")

    def tensor(self, stored: StoredTensor) -> Tensor:
        """Read a tensor of the pickle.

        Raises:
            ValueError: its storage is missing or damaged, or the tensor reaches out of it.
        """
        dtype: torch.dtype = getattr(torch, stored.dtype)  # one of pickle_reader.DTYPES
        entry = self._entries.get(f"data/{stored.key}")
        if entry is None or entry.file_size != stored.elements * dtype.itemsize:
            self._refuse(f"has no storage {stored.key[:20]!r} of {stored.elements} elements of {stored.dtype}")
        numbers = (stored.offset, *stored.size, *stored.stride)
        last = stored.offset + sum((length - 1) * step for length, step in zip(stored.size, stored.stride))
        if (
            len(stored.size) != len(stored.stride)
            or min(numbers) < 0
            or math.prod(stored.size) > stored.elements  # no repetition by strides of 0
            or (math.prod(stored.size) > 0 and last >= stored.elements)
        ):
            self._refuse(f"has a tensor that reaches out of its storage {stored.key[:20]!r}")
        if math.prod(stored.size) == 0:
            return torch.empty(stored.size, dtype=dtype)
        flat = torch.frombuffer(bytearray(self._read(f"data/{stored.key}")), dtype=dtype)
        return flat.as_strided(stored.size, stored.stride, stored.offset)

    def _checked_entries(self) -> dict[str, zipfile.ZipInfo]:
        """Every entry by its name without the archive's own folder."""
        entries = self._zip.infolist()
        names = [entry.filename for entry in entries]
        roots = {name.removesuffix("data.pkl") for name in names if name.count("/") == 1 and name.endswith("/data.pkl")}
        if len(roots) != 1 or len(set(names)) != len(names):
            self._refuse("does not hold one data.pkl")
        root = roots.pop()
        if not all(name.startswith(root) and ".." not in name.split("/") for name in names):
            self._refuse("has entries outside of its folder")
        if any(entry.compress_type != zipfile.ZIP_STORED or entry.flag_bits & 1 for entry in entries):
            self._refuse("has compressed or encrypted entries")
        if sum(entry.file_size for entry in entries) > self.path.stat().st_size:
            self._refuse("has entries that overlap")
        return {entry.filename.removeprefix(root): entry for entry in entries}

    def _read(self, name: str) -> bytes:
        try:
            return self._zip.read(self._entries[name])
        except DAMAGE as error:
            raise ValueError(f"{self.path}: damaged zip archive: {error}") from error

    def _refuse(self, what: str) -> NoReturn:
        raise ValueError(f"{self.path}: refused: it {what}, expected a checkpoint as torch.save writes it")
