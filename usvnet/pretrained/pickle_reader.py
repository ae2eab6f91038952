"""A pickle read without unpickling: a machine for the few opcodes of a checkpoint that can call nothing.

Python's own unpickler calls whatever a file names, and even a restricted one looks names up, calls ``__setstate__`` and
allocates what the file says. Here a name stays a name. An object becomes a :class:`Record` of its class's name and its
state, a tensor a :class:`StoredTensor` that says where its numbers lie; whatever else a name could do is refused. The
opcodes are those that ``torch.save`` writes (protocol 2), parsed by :mod:`pickletools`.
"""

import pickletools
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, NamedTuple, NoReturn

MAX_BYTES = 16 * 2**20
"""Largest pickle read: that of a large network's checkpoint in the middle of its training has half a mebibyte."""

DTYPES = {
    "torch.HalfStorage": "float16",
    "torch.BFloat16Storage": "bfloat16",
    "torch.FloatStorage": "float32",
    "torch.DoubleStorage": "float64",
    "torch.BoolStorage": "bool",
    "torch.ByteStorage": "uint8",
    "torch.CharStorage": "int8",
    "torch.ShortStorage": "int16",
    "torch.IntStorage": "int32",
    "torch.LongStorage": "int64",
}
"""Types of storages and what torch calls the type of their elements."""
RECORD_PREFIXES = ("ultralytics.", "torch.nn.modules.")
"""Packages whose classes make up a model's tree."""
RECORDS = frozenset(
    {
        *("torch.device", "types.SimpleNamespace", "pathlib.PosixPath", "pathlib.WindowsPath"),
        *("numpy.dtype", "numpy.core.multiarray.scalar", "numpy._core.multiarray.scalar", "_codecs.encode"),
    }
)
"""Other values seen in checkpoints (settings, scores): kept as records like the rest, so none is ever called."""


@dataclass(eq=False, repr=False)
class Record:
    """An object of the file, of which only the class's name and what it holds are known."""

    name: str
    state: Any = None


@dataclass(frozen=True)
class Name:
    """A name of the file that is on the list, ``module.name``; it stands for nothing."""

    text: str


class StoredTensor(NamedTuple):
    """Where a tensor's numbers lie in the archive; nothing of it has been checked but the types."""

    dtype: str
    key: str
    """Of its storage."""
    elements: int
    """Of its storage."""
    offset: int
    size: tuple[int, ...]
    stride: tuple[int, ...]


class RefusedError(ValueError):
    """The pickle holds what no checkpoint needs."""


def read_pickle(data: bytes, source: str) -> Any:
    """Read a pickle into dictionaries, lists, tuples, plain values, records and stored tensors.

    Args:
        data: the pickle.
        source: file that it comes from, for the messages.

    Raises:
        ValueError: it is damaged, too large, or holds anything that is not on the lists above.
    """
    if len(data) > MAX_BYTES:
        raise ValueError(f"{source}: its pickle has {len(data)} bytes, expected at most {MAX_BYTES}")
    try:
        return _Machine(source).run(data)
    except RefusedError:
        raise
    except (ValueError, LookupError, TypeError) as error:  # of pickletools, of an empty stack, of an unhashable key
        raise ValueError(f"{source}: its pickle is damaged, expected one that torch.save wrote") from error


class _Machine:
    """The stack, the stacks set aside at each MARK, and the memo."""

    def __init__(self, source: str) -> None:
        self.source = source
        self.position = 0
        self.stack: list[Any] = []
        self.outer: list[list[Any]] = []
        self.memo: dict[int, Any] = {}

    def run(self, data: bytes) -> Any:
        for opcode, argument, position in pickletools.genops(data):
            self.position = position or 0
            self.step(opcode.name, argument)
        return self.stack.pop()  # genops ends after STOP, or raises

    def step(self, opcode: str, argument: Any) -> None:
        match opcode:
            case "PROTO" | "STOP":
                pass
            case "BINGET" | "LONG_BINGET":
                self.stack.append(self.memo[argument])
            case "BINPUT" | "LONG_BINPUT":
                self.memo[argument] = self.stack[-1]
            case "BININT" | "BININT1" | "BININT2" | "LONG1" | "BINFLOAT" | "BINUNICODE":
                self.stack.append(argument)
            case "NONE":
                self.stack.append(None)
            case "NEWTRUE" | "NEWFALSE":
                self.stack.append(opcode == "NEWTRUE")
            case "EMPTY_DICT":
                self.stack.append({})
            case "EMPTY_LIST":
                self.stack.append([])
            case "EMPTY_TUPLE":
                self.stack.append(())
            case "TUPLE1" | "TUPLE2" | "TUPLE3":
                items = [self.stack.pop() for _ in range(int(opcode[-1]))]
                self.stack.append(tuple(reversed(items)))
            case "MARK":
                self.outer.append(self.stack)
                self.stack = []
            case "TUPLE":
                items = self.to_mark()
                self.stack.append(tuple(items))
            case "APPEND":
                self.extend([self.stack.pop()])
            case "APPENDS":
                self.extend(self.to_mark())
            case "SETITEM":
                value, key = self.stack.pop(), self.stack.pop()
                self.set_items([key, value])
            case "SETITEMS":
                self.set_items(self.to_mark())
            case "GLOBAL":
                self.name(argument.replace(" ", "."))
            case "REDUCE" | "NEWOBJ":
                self.make()
            case "BUILD":
                self.set_state()
            case "BINPERSID":
                self.storage()
            case _:
                self.refuse(f"uses the opcode {opcode}")

    def refuse(self, what: str) -> NoReturn:
        raise RefusedError(
            f"{self.source}: refused, and nothing was run: its pickle {what[:200]} (byte {self.position}), "
            f"expected only the tensors and settings of an Ultralytics checkpoint"
        )

    def to_mark(self) -> list[Any]:
        items, self.stack = self.stack, self.outer.pop()
        return items

    def extend(self, items: list[Any]) -> None:
        if type(self.stack[-1]) is not list:
            self.refuse("appends to something that is not a list")
        self.stack[-1].extend(items)

    def set_items(self, items: list[Any]) -> None:
        target = self.stack[-1]
        if type(target) is not dict:
            self.refuse("sets keys of something that is not a dictionary")
        for key, value in zip(items[::2], items[1::2], strict=True):
            if not isinstance(key, str | int | float | None):  # hashing nested tuples can take for ever
                self.refuse("has a key that is neither text nor a number")
            target[key] = value

    def name(self, text: str) -> None:
        if not (text.startswith(RECORD_PREFIXES) or text in RECORDS or text in CALLS or text in DTYPES):
            self.refuse(f"asks for {text!r}")
        self.stack.append(Name(text))

    def make(self) -> None:
        """What would be a call becomes a record, or one of the plain values of :data:`CALLS`."""
        arguments, name = self.stack.pop(), self.stack.pop()
        if type(name) is not Name or type(arguments) is not tuple or name.text in DTYPES:
            self.refuse("calls something that is not on the list")
        self.stack.append(CALLS[name.text](*arguments) if name.text in CALLS else Record(name.text))

    def set_state(self) -> None:
        """A record gets its state; what a dictionary of torch carries along (``_metadata``) is dropped."""
        state, target = self.stack.pop(), self.stack[-1]
        if isinstance(target, Record):
            target.state = state
        elif type(target) is not dict:
            self.refuse("sets the state of something that is not a part of a model")

    def storage(self) -> None:
        kind, storage_type, key, _device, elements = self.stack.pop()
        if kind != "storage" or type(storage_type) is not Name or storage_type.text not in DTYPES:
            self.refuse("has a storage of an unknown type")
        if type(key) is not str or type(elements) is not int:
            self.refuse("has a storage without key or size")
        self.stack.append(StoredTensor(DTYPES[storage_type.text], key, elements, 0, (elements,), (1,)))


def _rebuild_tensor(storage: StoredTensor, offset: int, size: Any, stride: Any, *_rest: object) -> StoredTensor:
    """The arguments of ``torch._utils._rebuild_tensor_v2``."""
    numbers = (offset, *size, *stride)
    if type(storage) is not StoredTensor or not all(type(number) is int for number in numbers):
        raise TypeError("not the arguments of a tensor")
    return storage._replace(offset=offset, size=tuple(size), stride=tuple(stride))


def _rebuild_parameter(data: StoredTensor, *_rest: object) -> StoredTensor:
    """The arguments of ``torch._utils._rebuild_parameter``."""
    return data


def _plain_dict(*_pairs: object) -> dict[Any, Any]:
    """An OrderedDict of torch.nn is written empty and filled by SETITEMS."""
    return {}


def _plain_list(items: list[Any]) -> list[Any]:
    """A set's members, which may be anything: nothing is hashed."""
    return items


CALLS: dict[str, Callable[..., Any]] = {
    "collections.OrderedDict": _plain_dict,
    "__builtin__.set": _plain_list,
    "torch.Size": tuple,
    "torch._utils._rebuild_tensor_v2": _rebuild_tensor,
    "torch._utils._rebuild_parameter": _rebuild_parameter,
}
"""The only names that make something else than a record, and the functions of ours that make it."""
