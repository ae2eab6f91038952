"""Drawing: boats on their pictures, pictures side by side."""

from usvnet.visualize.boats import BoatDrawing, close_up, draw_boats, range_label
from usvnet.visualize.canvas import GREEN, INK, RED, WHITE, Picture
from usvnet.visualize.records import draw_boat
from usvnet.visualize.sheet import contact_sheet

__all__ = [
    "GREEN",
    "INK",
    "RED",
    "WHITE",
    "BoatDrawing",
    "Picture",
    "close_up",
    "contact_sheet",
    "draw_boat",
    "draw_boats",
    "range_label",
]
