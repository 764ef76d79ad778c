"""Which trigger an image belongs to, as far as its witnesses say: all that is possible, and what
is likely.
"""

from __future__ import annotations

from dataclasses import dataclass

NOWHERE = 1 << 40  # more triggers than any run has


@dataclass(slots=True)
class Verdict:
    """How many triggers the camera has missed before an image: between `low` and `high`, likely
    `best`. As exposures are numbered by the camera, this is the image's trigger.

    Attributes
    ----------
    extras : int
        Exposures so far that may have had no trigger.
    by_rule : bool
        Whether a witness stands for `high`, so that time can prove it.
    why : str
        What is in doubt.
    """

    low: int = 0
    high: int = 0
    best: int = 0
    extras: int = 0
    by_rule: bool = True
    why: str = ""

    @property
    def is_certain(self) -> bool:
        """Whether only one answer is possible."""
        return self.low == self.high

    def with_step(
        self, counted: int | None, doubtful: int, likely: int, stamped: int | None, extras: int
    ) -> Verdict:
        """The verdict on the next image: what count and timestamps say was missed between, None if
        they do not know.

        Where both agree it is so. Where one speaks alone, a miss that it tells may also be its own
        fault; where both are silent, anything may have been missed.
        """
        was_clear = self.is_certain
        if stamped is not None and counted == stamped and not doubtful:
            moved = (self.low + stamped, self.high + stamped, self.best + stamped)
            return Verdict(*moved, self.extras, self.by_rule, self.why * (not was_clear))
        if counted is None and stamped is None:
            why = self.why or "neither a count nor a timestamp tells which triggers were missed"
            return Verdict(self.low - extras, NOWHERE, self.best, self.extras + extras, False, why)
        said = [missed for missed in (counted, stamped) if missed is not None]
        high = self.high + max(*said, (counted or 0) + doubtful)
        best = self.best + (likely if counted is not None else said[0])
        if counted is not None and stamped is not None:
            best = self.best + min(said)
        why = self.why
        if max(said) or doubtful or extras:
            why = "the board's count and the camera's timestamps differ"
            if stamped is None:
                why = "the board's count has a gap or a glitch, and no timestamp confirms it"
            elif counted is None:
                why = "a timestamp tells of missed triggers, and no counter confirms it"
        return Verdict(
            self.low - extras, high, best, self.extras + extras, self.by_rule or was_clear, why
        )
