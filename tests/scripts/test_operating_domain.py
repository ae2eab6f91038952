"""The tables of docs/operating-domain.md: the rule that the page states, and figures that it prints."""

import math
import runpy

import cv2
import pytest

BEARING = math.radians(10)


def test_the_page_states_what_the_script_computes(root, monkeypatch, tmp_path, capsys):
    monkeypatch.chdir(root)
    script = runpy.run_path(str(root / "scripts" / "operating_domain.py"))
    script["main"](output=tmp_path)
    page = (root / "docs" / "operating-domain.md").read_text()
    rows = [line for line in capsys.readouterr().out.splitlines() if line.startswith("| ") and "%" in line]
    waves = [row for row in rows if row.startswith(("| 0.02 m", "| 0.05 m", "| 0.1 m", "| 0.2 m"))]
    assert len(rows) == 17
    assert len(waves) == 4
    assert [row for row in rows if row not in waves and row not in page] == []
    assert cv2.imread(str(tmp_path / "operating-domain.png")).shape[1] > 1000


@pytest.mark.parametrize("distance_m", [5.0, 20.0, 100.0])
def test_the_rule(root, distance_m):
    """Exact for everything but the pixel, which the rule takes for an angle of 1 / f wherever it is in the picture."""
    script = runpy.run_path(str(root / "scripts" / "operating_domain.py"))
    settings = script["load_sensitivity"](root / "configs" / "sensitivity" / "domain.yaml")
    camera, hull = script["load_camera"](settings.camera), script["load_hull"](settings.hull)

    def share(name: str, std: float) -> float:
        return script["range_std"](camera, hull, settings, {name: std})[distance_m]

    steepness = math.sqrt(distance_m**2 - 1.5**2) / 1.5
    assert share("pitch_deg", 0.1) == pytest.approx(math.radians(0.1) * steepness * math.cos(BEARING), rel=1e-5)
    assert share("roll_deg", 0.1) == pytest.approx(math.radians(0.1) * steepness * math.sin(BEARING), rel=1e-2)
    assert share("height_m", 0.02) == pytest.approx(0.02 / 1.5, rel=1e-5)
    assert share("wave_m", 0.03) == pytest.approx(0.03 / 1.5, rel=1e-5)
    assert share("keypoint_px", 1.0) == pytest.approx(distance_m / (1.5 * 700), rel=0.12)
