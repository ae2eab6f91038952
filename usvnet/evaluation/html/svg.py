"""Matplotlib panels as SVG inside a page, in the colours of the page: they follow its light and dark theme."""

import io
import re
from collections.abc import Callable
from typing import Any, NamedTuple

from markupsafe import Markup, escape
from matplotlib import colormaps, rc_context
from matplotlib.axes import Axes
from matplotlib.colors import to_hex
from matplotlib.figure import Figure

LARGE_IN, SMALL_IN = (4.8, 3.4), (4.0, 3.1)
"""Two beside each other, or three and four."""
STYLE: dict[Any, Any] = {
    "svg.fonttype": "none",  # text stays text: it can be read aloud, searched and set in the page's font
    "text.parse_math": False,  # a scene may be called "$x"
    "font.size": 9.0,
    "axes.titlesize": 10.0,
    "axes.spines.top": False,
    "axes.spines.right": False,
}
SERIES = tuple(to_hex(colour) for colour in colormaps["tab10"].colors)  # type: ignore[attr-defined]
"""What Matplotlib calls C0 to C9; the page's style sheet says what they look like."""
THEME = {
    **{colour: f"var(--c{n})" for n, colour in enumerate(SERIES)},
    "#000000": "var(--ink)",
    "#ffffff": "var(--paper)",
    "#808080": "var(--line)",
    "#b0b0b0": "var(--line)",
    "#d9d9d9": "var(--band)",
}
"""Colours of Matplotlib -> of the page."""
NO_METADATA = {"Creator": None, "Date": None, "Format": None, "Type": None}


class Panel(NamedTuple):
    """One drawing."""

    label: str
    """What it shows, for those who do not see it."""
    svg: Markup


def draw_panel(name: str, label: str, draw: Callable[[Axes], object], size_in: tuple[float, float] = LARGE_IN) -> Panel:
    """Draw a panel as an ``<svg>`` element.

    Args:
        name: of its own on the page; identifiers inside are made from it.
        label: what it shows, in words.
        draw: draws on the axes that it is given, in Matplotlib's default colours.
        size_in: width and height, inches.
    """
    text = io.StringIO()
    with rc_context({**STYLE, "svg.hashsalt": name}):
        figure = Figure(figsize=size_in, layout="constrained")
        draw(figure.subplots())
        figure.savefig(text, format="svg", transparent=True, dpi=150, metadata=NO_METADATA)
    return Panel(label, _inline(text.getvalue(), label))


def _inline(document: str, label: str) -> Markup:
    """Make an element of a document: no prolog, namespaces, comments or styles, no identifier but those pointed at."""
    element = document[document.index("<svg") :]
    element = re.sub(r"<!--.*?-->\n?|<style\b.*?</style>", "", element, flags=re.DOTALL)
    element = re.sub(r' xmlns(:\w+)?="[^"]*"', "", element)
    element = re.sub(r'<g id="[^"]*"', "<g", element).replace("xlink:href=", "href=")
    for colour, variable in THEME.items():
        element = re.sub(rf"(?<=: ){colour}\b", variable, element)
    view_box = re.search(r'viewBox="[^"]*"', element)
    if view_box is None:
        raise RuntimeError("matplotlib wrote an SVG without a viewBox")
    body = element[element.index(">") + 1 :]
    return Markup('<svg {} role="img" aria-label="{}">{}').format(Markup(view_box[0]), escape(label), Markup(body))
