"""Why frames or samples are lost, counted by reason."""

from __future__ import annotations

import re
from collections import Counter

MOST_LISTED = 3  # reasons in the sentence
NUMBERS = re.compile(r"\d[\d.,]*")


class Losses:
    """Counts losses by reason; reasons that differ by their numbers only are one, told by the
    newest. One thread adds, any may read.
    """

    def __init__(self) -> None:
        self._counts: Counter[str] = Counter()
        self._newest: dict[str, str] = {}

    def add(self, reason: str, count: int = 1) -> None:
        """Count so many losses of a reason."""
        kind = NUMBERS.sub("#", reason)
        self._newest[kind] = reason
        self._counts[kind] += count

    def __str__(self) -> str:
        """``2 × no image came in time``, the most frequent first; empty where nothing is lost."""
        most_frequent = Counter(self._counts).most_common(MOST_LISTED)
        return "; ".join(f"{count} × {self._newest[kind]}" for kind, count in most_frequent)
