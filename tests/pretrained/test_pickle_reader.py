"""A checkpoint's pickle is read as far as it holds tensors and settings, and a malicious one runs nothing."""

import builtins
import os
import pickle
import struct
import subprocess
import sys
from collections import OrderedDict
from pathlib import PosixPath

import pytest
import torch
from torch import nn

from tests.pretrained.peer_files import STAND_INS, write
from usvnet.pretrained.archive import TorchArchive
from usvnet.pretrained.importer import import_weights
from usvnet.pretrained.pickle_reader import MAX_BYTES, Record, StoredTensor, read_pickle


def read(content, folder):
    with TorchArchive(write(folder / "peer.pt", content)) as archive:
        return read_pickle(archive.pickle(), "peer.pt")


def test_plain_values_come_back(tmp_path):
    content = {
        "epoch": -1,
        "updates": 2**40,
        "fitness": 0.25,
        "flags": [True, False, None],
        "names": {0: "usv"},
        "shapes": ((), (7,), (7, 3), (1, 2, 3), (1, 2, 3, 4)),
        "size": torch.Size([7, 3]),
        "text": "Süd",
        "ordered": OrderedDict(a=1),
        "set": {"bow"},
    }
    assert read(content, tmp_path) == content | {"size": (7, 3), "ordered": {"a": 1}, "set": ["bow"]}


def test_tensors_say_where_they_lie(tmp_path):
    weight = torch.arange(6.0)
    content = {"whole": weight, "column": weight.view(2, 3)[:, 1], "parameter": nn.Parameter(torch.ones(2).half())}
    found = read(content, tmp_path)
    assert found["whole"] == StoredTensor("float32", "0", 6, 0, (6,), (1,))
    assert found["column"] == StoredTensor("float32", "0", 6, 1, (2,), (3,))
    assert found["parameter"] == StoredTensor("float16", "1", 2, 0, (2,), (1,))


def test_objects_are_records_of_their_state(tmp_path):
    model = STAND_INS["PoseModel"]()
    model.add_module("norm", nn.BatchNorm2d(2))
    found = read({"model": model, "path": PosixPath("a/b"), "device": torch.device("cpu")}, tmp_path)
    assert isinstance(found["model"], Record)
    assert found["model"].name == "ultralytics.nn.tasks.PoseModel"
    norm = found["model"].state["_modules"]["norm"]
    assert norm.name == "torch.nn.modules.batchnorm.BatchNorm2d"
    assert norm.state["eps"] == 1e-5
    assert [found[key].name for key in ("path", "device")] == ["pathlib.PosixPath", "torch.device"]


class Call:
    """Calls something when it is unpickled."""

    def __init__(self, function, *arguments, state=None):
        self.reduced = (function, arguments) if state is None else (function, arguments, state)

    def __reduce__(self):
        return self.reduced


def marker(folder):
    return folder / "attacked"


def attacks(folder):
    """What would make a file of the name ``attacked``."""
    touch, code = f"touch {marker(folder)}", f"open({str(marker(folder))!r}, 'w')"
    return {
        "system": Call(os.system, touch),
        "popen": Call(subprocess.Popen, ["touch", str(marker(folder))]),
        "eval": Call(builtins.eval, code),
        "exec": Call(builtins.exec, code),
        "getattr": Call(getattr, Call(__import__, "os"), "system"),
        "nested": [{"deep": ({"er": Call(os.system, touch)},)}],
        "as a key": {Call(os.system, touch): 1},
        "through torch": Call(torch.storage._load_from_bytes, pickle.dumps(Call(os.system, touch))),
        "torch.load": Call(torch.load, str(folder / "peer.pt")),
        "state": Call(OrderedDict, state=Call(os.system, touch)),
    }


@pytest.mark.parametrize("name", attacks(PosixPath("x")))
def test_an_attack_is_refused_and_runs_nothing(name, tmp_path):
    path = write(tmp_path / "peer.pt", {"model": attacks(tmp_path)[name], "ema": None})
    with pytest.raises(ValueError, match=r"peer\.pt: refused, and nothing was run: its pickle asks for '\w") as error:
        import_weights(path)
    assert "\n" not in str(error.value)
    assert not marker(tmp_path).exists()


def test_the_attacks_would_have_worked(tmp_path):
    path = write(tmp_path / "peer.pt", {"model": attacks(tmp_path)["system"]})
    torch.load(path, weights_only=False)
    assert marker(tmp_path).exists()


def program(*parts):
    """A pickle of protocol 2 from its opcodes."""
    return b"\x80\x02" + b"".join(parts) + b"."


def text(value):
    return b"X" + struct.pack("<I", len(value)) + value.encode()


OBJECT = b"cultralytics.nn.tasks\nPoseModel\n)\x81"
SYSTEM = b"cos\nsystem\n"


@pytest.mark.parametrize(
    ("data", "message"),
    [
        (program(SYSTEM, b")R"), "asks for 'os.system'"),
        (program(SYSTEM), "asks for 'os.system'"),  # the name alone is enough
        (program(b"c__builtin__\ngetattr\n"), "asks for '__builtin__.getattr'"),
        (program(b"cultralytics\nos\n"), None),
        (program(text("os"), text("system"), b"\x93"), "uses the opcode STACK_GLOBAL"),
        (program(b"(ios\nsystem\n"), "uses the opcode INST"),
        (program(b"(", SYSTEM, b"o"), "asks for 'os.system'"),
        (program(b"\x82\x01"), "uses the opcode EXT1"),
        (program(b"Pevil\n"), "uses the opcode PERSID"),
        # BUILD: on a record it is only kept, whatever it is called; on anything else it is refused
        (program(OBJECT, b"}", text("__setstate__"), text("x"), b"sb"), None),
        (program(b"ccollections\nOrderedDict\n}b"), "sets the state of something"),
        (program(b"ctorch._utils\n_rebuild_parameter\n}b"), "sets the state of something"),
        (program(b"]}b"), "sets the state of something"),
        # calls of what is not a name, or not by arguments
        (program(OBJECT, b")R"), "calls something that is not on the list"),
        (program(text("os.system"), b")R"), "calls something that is not on the list"),
        (program(b"ctorch\nFloatStorage\n)R"), "calls something that is not on the list"),
        (program(b"ccollections\nOrderedDict\n]R"), "calls something that is not on the list"),
        # storages that are none
        (program(b"(", text("storage"), OBJECT, text("0"), text("cpu"), b"K\x01tQ"), "storage of an unknown type"),
        (program(b"(", text("storage"), SYSTEM, text("0"), text("cpu"), b"K\x01tQ"), "asks for 'os.system'"),
        (program(b"(", text("storage"), b"ctorch\nFloatStorage\n", OBJECT, text("cpu"), b"K\x01tQ"), "without key"),
        (program(b"(", text("module"), b"ctorch\nFloatStorage\n", text("0"), text("cpu"), b"K\x01tQ"), "unknown type"),
        # a key whose hash takes 2^n steps, containers of the wrong type
        (program(b"}", b")", b"2\x86" * 40, b"Ns"), "uses the opcode DUP"),
        (program(b"}", b")", b"q\x00h\x00\x86" * 60, b"Ns"), "a key that is neither text nor a number"),
        (program(b"]NNs"), "sets keys of something"),
        (program(b"}Na"), "appends to something"),
    ],
)
def test_a_hand_made_pickle(data, message):
    if message is None:
        before = set(sys.modules)
        assert isinstance(read_pickle(data, "peer.pt"), object)
        assert set(sys.modules) == before
        return
    with pytest.raises(ValueError, match=f"^peer.pt: refused, and nothing was run: its pickle .*{message}"):
        read_pickle(data, "peer.pt")


@pytest.mark.parametrize(
    "data",
    [
        b"",
        b"boats",
        program(b""),
        program(b"q\x00"),
        program(b"h\x07"),
        program(b"\x85"),
        program(b"t"),
        program(b"(}K\x01u"),
        program(b"}(K\x01u"),
        program(b"X\xff\xff\xff\xff"),  # a text of 4 GB
        program(b"\x8b\xff\xff\xff\x7f"),  # a number of 2 GB
        program(b"\x8e" + b"\xff" * 8),
        program(b"NN")[:-1],
        program(b"NQ"),
        program(b"ctorch\nSize\nN\x85R"),
        program(b"ctorch._utils\n_rebuild_tensor_v2\n)R"),
        program(b"ctorch._utils\n_rebuild_tensor_v2\n(NK\x00))NNtR"),
    ],
)
def test_a_damaged_pickle_is_named(data):
    with pytest.raises(ValueError, match=r"^peer\.pt: its pickle is damaged"):
        read_pickle(data, "peer.pt")


def test_every_byte_may_be_wrong(tmp_path):
    with TorchArchive(write(tmp_path / "peer.pt", {"model": nn.Linear(2, 1), "names": {0: "usv"}})) as archive:
        data = archive.pickle()
    for i in range(len(data)):
        for value in (ord("R"), ord("b"), data[i] ^ 0x80):
            try:
                read_pickle(data[:i] + bytes([value]) + data[i + 1 :], "peer.pt")
            except ValueError as error:
                assert str(error).startswith("peer.pt: ")  # noqa: PT017 (many changes do no harm)


def test_a_place_in_the_memo_costs_no_memory():
    assert read_pickle(program(b"Nr\xff\xff\xff\xff"), "peer.pt") is None


def test_a_huge_pickle_is_not_read():
    with pytest.raises(ValueError, match="expected at most"):
        read_pickle(bytes(MAX_BYTES + 1), "peer.pt")
