"""The zip archive of a checkpoint: tensors come back as they were, and tricks with names and sizes are refused."""

import zipfile

import pytest
import torch

from usvnet.pretrained.archive import TorchArchive
from usvnet.pretrained.pickle_reader import MAX_BYTES, StoredTensor, read_pickle


@pytest.mark.parametrize(
    "dtype", [torch.float16, torch.bfloat16, torch.float32, torch.float64, torch.int64, torch.uint8, torch.bool]
)
def test_tensors_come_back(dtype, tmp_path):
    weight = torch.arange(24).to(dtype).view(2, 3, 4)
    tensors = {"whole": weight, "moved": weight.permute(2, 0, 1), "part": weight[1, 1:], "one": weight[1, 2, 3]}
    tensors |= {"none": weight[:0], "alone": torch.zeros(0, 5, dtype=dtype)}
    torch.save(tensors, tmp_path / "peer.pt")
    with TorchArchive(tmp_path / "peer.pt") as archive:
        for name, stored in read_pickle(archive.pickle(), "peer.pt").items():
            found = archive.tensor(stored)
            assert found.dtype == dtype
            assert torch.equal(found, tensors[name])


def archive_of(folder, entries, compression=zipfile.ZIP_STORED):
    path = folder / "peer.pt"
    with zipfile.ZipFile(path, "w", compression) as archive:
        for name, data in entries:
            archive.writestr(name, data)
    return path


GOOD = [("peer/data.pkl", b"\x80\x02}."), ("peer/byteorder", b"little"), ("peer/data/0", bytes(16))]


@pytest.mark.parametrize(
    ("stored", "message"),
    [
        (StoredTensor("float32", "1", 4, 0, (4,), (1,)), "no storage '1' of 4 elements"),
        (StoredTensor("float32", "../data.pkl", 4, 0, (4,), (1,)), r"no storage '\.\./data\.pkl'"),
        (StoredTensor("float32", "0", 5, 0, (5,), (1,)), "no storage '0' of 5 elements"),
        (StoredTensor("float32", "0", 2**62, 0, (2**62,), (1,)), "no storage '0'"),
        (StoredTensor("float32", "0", 4, 0, (2**40,), (0,)), "reaches out of its storage"),
        (StoredTensor("float32", "0", 4, 0, (2**40, 2**40), (1, 1)), "reaches out of its storage"),
        (StoredTensor("float32", "0", 4, 0, (5,), (1,)), "reaches out of its storage"),
        (StoredTensor("float32", "0", 4, 2, (3,), (1,)), "reaches out of its storage"),
        (StoredTensor("float32", "0", 4, 0, (2, 2), (3, 1)), "reaches out of its storage"),
        (StoredTensor("float32", "0", 4, -1, (4,), (1,)), "reaches out of its storage"),
        (StoredTensor("float32", "0", 4, 3, (4,), (-1,)), "reaches out of its storage"),
        (StoredTensor("float32", "0", 4, 0, (-1, -4), (4, 1)), "reaches out of its storage"),
        (StoredTensor("float32", "0", 4, 0, (4,), (1, 1)), "reaches out of its storage"),
    ],
)
def test_a_tensor_outside_of_its_storage_is_refused(stored, message, tmp_path):
    with TorchArchive(archive_of(tmp_path, GOOD)) as archive:
        assert torch.equal(archive.tensor(StoredTensor("float32", "0", 4, 0, (4,), (1,))), torch.zeros(4))
        with pytest.raises(ValueError, match=rf"peer\.pt: refused: it has .*{message}"):
            archive.tensor(stored)


@pytest.mark.parametrize(
    ("entries", "message"),
    [
        ([], "does not hold one data.pkl"),
        (GOOD[1:], "does not hold one data.pkl"),
        ([*GOOD, ("other/data.pkl", b".")], "does not hold one data.pkl"),
        ([*GOOD, ("../evil.py", b"x")], "entries outside of its folder"),
        ([*GOOD, ("peer/../../evil.py", b"x")], "entries outside of its folder"),
        ([*GOOD, ("/etc/passwd", b"x")], "entries outside of its folder"),
        ([GOOD[0], ("peer/byteorder", b"big")], "big-endian"),
    ],
)
def test_an_archive_with_tricks_is_refused(entries, message, tmp_path):
    with pytest.raises(ValueError, match=rf"peer\.pt: refused: it .*{message}"):
        TorchArchive(archive_of(tmp_path, entries))


@pytest.mark.filterwarnings("ignore:Duplicate name")
def test_two_entries_of_one_name_are_refused(tmp_path):
    with pytest.raises(ValueError, match=r"does not hold one data\.pkl"):
        TorchArchive(archive_of(tmp_path, [*GOOD, GOOD[0]]))


def test_a_bomb_is_refused(tmp_path):
    path = archive_of(tmp_path, [GOOD[0], ("peer/data/0", bytes(2**24))], zipfile.ZIP_DEFLATED)
    assert path.stat().st_size < 2**16
    with pytest.raises(ValueError, match="compressed or encrypted entries"):
        TorchArchive(path)


def test_entries_that_say_they_are_larger_than_the_file_are_refused(tmp_path):
    path = archive_of(tmp_path, GOOD)
    data = bytearray(path.read_bytes())
    directory = data.rindex(b"PK\x01\x02")  # of data/0, with its sizes from byte 20 on
    data[directory + 20 : directory + 28] = (2**30).to_bytes(4, "little") * 2
    path.write_bytes(data)
    with pytest.raises(ValueError, match="entries that overlap"):
        TorchArchive(path)


def test_a_large_pickle_is_not_even_read(tmp_path):
    path = archive_of(tmp_path, [("peer/data.pkl", bytes(MAX_BYTES + 1))])
    with TorchArchive(path) as archive, pytest.raises(ValueError, match=r"has a data\.pkl of more than"):
        archive.pickle()


def test_a_file_of_something_else_is_refused(tmp_path):
    for content in (b"", b"boats", b"PK\x03\x04 half a zip"):
        (tmp_path / "peer.pt").write_bytes(content)
        with pytest.raises(ValueError, match=r"peer\.pt: refused: it is not a zip archive"):
            TorchArchive(tmp_path / "peer.pt")
    with pytest.raises(FileNotFoundError, match=r"none\.pt: no such file"):
        TorchArchive(tmp_path / "none.pt")


def test_a_damaged_storage_is_named(tmp_path):
    path = archive_of(tmp_path, GOOD)
    data = path.read_bytes()
    path.write_bytes(data.replace(bytes(16), b"\x01" + bytes(15), 1))
    with TorchArchive(path) as archive, pytest.raises(ValueError, match=r"peer\.pt: damaged zip archive: .*CRC"):
        archive.tensor(StoredTensor("float32", "0", 4, 0, (4,), (1,)))


def test_every_byte_of_an_archive_may_be_wrong(tmp_path):
    good = archive_of(tmp_path, GOOD).read_bytes()
    stored = StoredTensor("float32", "0", 4, 0, (4,), (1,))
    for i in range(len(good)):
        for value in (0xFF, good[i] ^ 0x80):
            (tmp_path / "peer.pt").write_bytes(good[:i] + bytes([value]) + good[i + 1 :])
            try:
                with TorchArchive(tmp_path / "peer.pt") as archive:
                    archive.pickle()
                    archive.tensor(stored)
            except ValueError as error:
                assert "peer.pt: " in str(error)  # noqa: PT017 (some changes do no harm)
