import os
import subprocess
import sys

import numpy as np
import pytest

from usvnet.simulator import engine

RENDER = """
import sys, numpy as np
from tests.simulator.small_frames import frame
from usvnet.simulator.frame import render_frame
rendered = render_frame(frame(), "standard")
boat = rendered.boats[0]
np.savez(sys.argv[1], picture=rendered.picture, keypoints=boat.keypoints_px, visibility=boat.visibility)
"""


@pytest.fixture(autouse=True)
def fresh():
    engine.choose_engine.cache_clear()
    yield
    engine.choose_engine.cache_clear()


def test_an_unknown_engine_is_one_clear_sentence(monkeypatch):
    pytest.importorskip("mitsuba", reason="the extra sim is not installed")
    monkeypatch.setenv(engine.ENGINE_VARIABLE, "fast")
    with pytest.raises(ValueError, match="USVNET_ENGINE is fast, expected cuda_ad_rgb, llvm_ad_rgb, scalar_rgb"):
        engine.choose_engine()


def test_a_missing_package_is_named_with_the_command_that_helps(monkeypatch):
    monkeypatch.setattr(engine, "PACKAGES", ("numpy", "no_such_renderer"))
    with pytest.raises(ValueError, match=r"rendering needs no_such_renderer: pip install 'usvnet\[sim\]'"):
        engine.check_installed()
    assert engine.doctor()[-1].startswith("to render: pip install")


def test_an_engine_that_aborts_is_passed_over(monkeypatch):
    """An LLVM that does not fit kills the process; the next engine is taken and the doctor says what happened."""
    pytest.importorskip("mitsuba", reason="the extra sim is not installed")
    monkeypatch.delenv(engine.ENGINE_VARIABLE, raising=False)
    aborting = "import os, sys\nif sys.argv[1] != 'scalar_rgb': os.abort()\nprint('drew')"
    monkeypatch.setattr(engine, "PROBE", aborting)
    engine.try_engine.cache_clear()
    try:
        assert engine.choose_engine() == "scalar_rgb"
        lines = engine.doctor()
    finally:
        engine.try_engine.cache_clear()
    assert any(line.startswith("llvm_ad_rgb: no (the process was aborted") for line in lines)
    assert "rendering uses scalar_rgb" in lines
    assert "libllvm15" in " ".join(lines)
    assert engine.slow_engine_notice("scalar_rgb")
    assert not engine.slow_engine_notice("llvm_ad_rgb")


def test_both_engines_draw_and_label_the_same(tmp_path):
    pytest.importorskip("mitsuba", reason="the extra sim is not installed")
    pytest.importorskip("pyoidn", reason="the extra sim is not installed")
    if engine.try_engine("llvm_ad_rgb"):
        pytest.skip(f"llvm_ad_rgb does not work here: {engine.try_engine('llvm_ad_rgb')}")
    found = []
    for name in ("llvm_ad_rgb", "scalar_rgb"):
        out = tmp_path / f"{name}.npz"
        environment = {**os.environ, engine.ENGINE_VARIABLE: name}
        subprocess.run([sys.executable, "-c", RENDER, str(out)], env=environment, check=True)
        found.append(np.load(out))
    assert np.abs(found[0]["keypoints"] - found[1]["keypoints"]).max() < 1e-9
    assert np.array_equal(found[0]["visibility"], found[1]["visibility"])
    assert np.abs(found[0]["picture"].astype(float) - found[1]["picture"]).mean() < 3
