"""A figure in shades of grey, as a black-and-white printer would show it."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.collections import Collection
from matplotlib.colors import to_rgba_array
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from matplotlib.text import Annotation, Text

LIGHTNESS = (0.299, 0.587, 0.114)  # of red, green and blue
_COLOURED = {  # kind of artist -> what of it has a colour
    Line2D: ("color", "markerfacecolor", "markeredgecolor"),
    Patch: ("facecolor", "edgecolor"),
    Collection: ("facecolor", "edgecolor"),
    Text: ("color",),
}


def in_grey(figure: Figure) -> None:
    """Give every line, area and text of a figure the grey of its own lightness; images are grey by
    their colour map.
    """
    arrows = [note.arrow_patch for note in figure.findobj(Annotation) if note.arrow_patch]
    for kind, names in _COLOURED.items():
        for artist in [*figure.findobj(kind), *(arrows if kind is Patch else ())]:
            for name in names:
                colour: Any = getattr(artist, f"get_{name}")()
                if isinstance(colour, str) and colour in ("none", "auto"):
                    continue
                grey = greys(colour)
                many = isinstance(artist, Collection)
                getattr(artist, f"set_{name}")(grey if many else tuple(grey[0]))


def greys(colours: Any) -> np.ndarray:
    """The greys of the same lightness as some colours, shape (colours, 4), red, green, blue and
    opacity from 0 to 1.
    """
    rgba = np.array(to_rgba_array(colours))
    rgba[:, :3] = (rgba[:, :3] @ LIGHTNESS)[:, None]
    return rgba
