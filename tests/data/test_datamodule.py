from pathlib import Path

import pytest
import torch
import yaml
from jsonargparse import ArgumentParser
from lightning.pytorch import Trainer

from usvnet.data import AugmentationConfig, BoatDataModule
from usvnet.types import Batch


def test_the_loaders_see_every_picture(tiny: Path):
    data = BoatDataModule(str(tiny), image_size=64, batch_size=3)
    data.setup("fit")
    torch.manual_seed(0)
    loader = data.train_dataloader()
    epochs = []
    for epoch in range(6):
        loader.sampler.set_epoch(epoch)
        epochs.append(torch.cat([batch.frame_index for batch in loader]).tolist())
    assert all(sorted(epoch) == [0, 1, 2, 3] for epoch in epochs)
    assert len(set(map(tuple, epochs))) > 1
    assert [batch.frame_index.tolist() for batch in data.val_dataloader()] == [[0, 1]]
    data.setup("test")
    assert [frame.name for frame in data.frames("test")] == ["test/0006.png"]
    assert len(list(data.test_dataloader())) == 1


def test_only_training_pictures_are_augmented(tiny: Path):
    data = BoatDataModule(str(tiny), image_size=64)
    assert [data.dataset(split).augmentation for split in ("val", "test")] == [None, None]
    assert data.dataset("train").augmentation == AugmentationConfig()


@pytest.mark.parametrize(("epochs", "closing", "first"), [(50, 0.2, 40), (3, 0.2, 2), (10, 0, 10), (-1, 0.2, None)])
def test_the_trainer_says_where_the_run_ends(tiny: Path, epochs: int, closing: float, first: int | None):
    data = BoatDataModule(str(tiny), image_size=64, augmentation=AugmentationConfig(closing=closing))
    data.trainer = Trainer(max_epochs=epochs, logger=False, enable_checkpointing=False, accelerator="cpu")
    data.train_dataloader()
    assert data.dataset("train").closing_epoch == first


def epoch_with_workers(root: Path) -> tuple[list[int], Batch]:
    torch.manual_seed(3)
    data = BoatDataModule(str(root), image_size=64, batch_size=2, num_workers=2)
    batches = list(data.train_dataloader())
    return [int(i) for batch in batches for i in batch.frame_index], batches[0]


def test_workers_repeat_themselves_but_not_each_other(tiny: Path):
    order, first = epoch_with_workers(tiny)
    again, repeated = epoch_with_workers(tiny)
    assert order == again
    assert torch.equal(first.image, repeated.image)
    torch.manual_seed(3)
    alone = BoatDataModule(str(tiny), image_size=64, batch_size=2)
    assert next(iter(alone.val_dataloader())).image.shape == (2, 3, 64, 64)


def test_an_epoch_is_the_same_with_and_without_workers_and_whatever_was_drawn_before(tiny: Path):
    _, first = epoch_with_workers(tiny)
    torch.manual_seed(3)
    alone = BoatDataModule(str(tiny), image_size=64, batch_size=2).train_dataloader()
    torch.rand(100)
    assert torch.equal(next(iter(alone)).image, first.image)
    alone.sampler.set_epoch(1)
    assert not torch.equal(next(iter(alone)).image, first.image)


def test_the_two_workers_draw_different_numbers(tiny: Path):
    for path in (tiny / "images" / "train").glob("000[1-3].png"):
        path.write_bytes((tiny / "images" / "train" / "0000.png").read_bytes())
        (tiny / "labels" / "train" / path.stem).with_suffix(".txt").write_text(
            (tiny / "labels" / "train" / "0000.txt").read_text()
        )
    data = BoatDataModule(str(tiny), image_size=64, batch_size=1, num_workers=2)
    torch.manual_seed(3)
    pictures = [batch.image for batch in data.train_dataloader()]
    assert not torch.equal(pictures[0], pictures[1])


def test_faults_show_before_training(tiny: Path):
    path = tiny / "images" / "train" / "0002.png"
    path.write_bytes(path.read_bytes()[:300])
    with pytest.raises(ValueError, match=r"0002\.png: corrupt picture"):
        BoatDataModule(str(tiny), image_size=64).setup("fit")


@pytest.mark.parametrize("settings", [{"image_size": 100}, {"image_size": 0}, {"batch_size": 0}, {"num_workers": -1}])
def test_a_bad_setting_is_named(tiny: Path, settings: dict[str, int]):
    name, value = next(iter(settings.items()))
    with pytest.raises(ValueError, match=f"{name} is {value}|{name} {value}"):
        BoatDataModule(str(tiny), **settings)


def build(settings: dict[str, object], *arguments: str) -> BoatDataModule:
    parser = ArgumentParser(exit_on_error=False)
    parser.add_class_arguments(BoatDataModule, "data")
    parser.add_argument("--config", action="config")
    read = parser.parse_args([f"--config={yaml.safe_dump({'data': settings})}", *arguments])
    return parser.instantiate(read).data


def test_a_config_file_builds_it():
    data = build({"root": "somewhere", "image_size": 64, "augmentation": {"zoom": [0.9, 1.1]}}, "--data.batch_size=4")
    assert data.augmentation == AugmentationConfig(zoom=(0.9, 1.1))
    assert (data.batch_size, data.image_size) == (4, 64)
    assert build({"root": "somewhere"}).augmentation == AugmentationConfig()
    assert build({"root": "somewhere", "augmentation": None}).augmentation is None
    assert build({"root": "somewhere"}, "--data.augmentation.mirror=0").augmentation == AugmentationConfig(mirror=0)


def test_an_unknown_key_of_the_augmentation_is_refused():
    with pytest.raises(Exception, match="miror"):
        build({"root": "somewhere", "augmentation": {"miror": 1.0}})
