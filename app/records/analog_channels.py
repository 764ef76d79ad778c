"""The further analog channels that a session holds beside the forces."""

from __future__ import annotations

import re

from app.records.schema import column, record


@record("/entry/auxiliary", since=4)
class Channels:
    """What each of them is called, in order."""

    name: tuple[str, ...] = column("name", "", "name of each channel", shape=("channels",))
    unit: tuple[str, ...] = column("unit", "", "unit of its values", shape=("channels",))

    @property
    def labels(self) -> list[str]:
        """Name and unit of each as one word of letters of ASCII, digits and ``_``, for other
        programs.
        """
        named = zip(self.name, self.unit, strict=True)
        texts = (re.sub("[\u00b5\u03bc]", "u", f"{name}_{unit}") for name, unit in named)
        return [re.sub(r"\W", "_", text, flags=re.ASCII) for text in texts]
