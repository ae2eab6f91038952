"""How far training pictures are changed."""

from dataclasses import dataclass

SHARES = (
    *("mirror", "translate", "mosaic", "paste", "closing"),
    *("hue", "saturation", "value", "glare", "fog", "dim", "blur", "noise"),
)


@dataclass(frozen=True)
class AugmentationConfig:
    """How far a training picture is changed. Zero (and a zoom of 1 to 1) turns a change off.

    Attributes:
        mirror: probability of left for right.
        zoom: smallest and largest scale, drawn evenly on a logarithmic scale.
        translate: widest empty border that a shift may open, as a fraction of the frame.
        roll_deg: largest turn of the camera about its optical axis, either way.
        mosaic: probability that four pictures share the frame; such a frame has poses but no ranges.
        paste: probability that a boat of another picture is pasted in; that boat has a pose but no range.
        closing: share of the run, at its end, without mosaics and pasted boats: pictures as they are in use.
        hue: largest shift, as a fraction of the colour circle.
        saturation: largest relative change.
        value: largest relative change of brightness.
        glare: probability of a streak of sunlight.
        fog: probability of fog, thin near the camera and thick from the nearest boat on.
        dim: probability of dusk: a fraction of the light, and the grain that comes with it.
        blur: probability of a Gaussian blur of 0.5 to 1.5 px.
        noise: probability of sensor noise, up to 8 grey levels.
    """

    mirror: float = 0.5
    zoom: tuple[float, float] = (0.6, 1.6)
    translate: float = 0.15
    roll_deg: float = 3.0
    mosaic: float = 0.5
    paste: float = 0.1
    closing: float = 0.2
    hue: float = 0.015
    saturation: float = 0.5
    value: float = 0.4
    glare: float = 0.05
    fog: float = 0.1
    dim: float = 0.1
    blur: float = 0.05
    noise: float = 0.05

    def __post_init__(self) -> None:
        """Check every value.

        Raises:
            ValueError: a value is out of its bounds.
        """
        for name in SHARES:
            if not 0 <= getattr(self, name) <= 1:
                raise ValueError(f"augmentation.{name} is {getattr(self, name)}, expected 0 to 1")
        if not 0 < self.zoom[0] <= self.zoom[1]:
            raise ValueError(f"augmentation.zoom is {list(self.zoom)}, expected a smallest and a largest scale above 0")
        if not 0 <= self.roll_deg <= 45:
            raise ValueError(f"augmentation.roll_deg is {self.roll_deg}, expected 0 to 45")
