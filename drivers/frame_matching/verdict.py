"""Which trigger an image belongs to, as far as its witnesses say: all that is possible, and what
is likely.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

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
    agreed : int
        What it was before the present doubt, and what both witnesses have said alike since.
    counted, stamped : int or None
        What each of them says by itself; None if it does not know.
    is_blind : bool
        Whether neither a count nor a timestamp tells on which sample it was exposed, so that an
        exposure without a trigger would pass for one with it, and nothing is certain.
    """

    low: int = 0
    high: int = 0
    best: int = 0
    extras: int = 0
    by_rule: bool = True
    why: str = ""
    agreed: int = 0
    counted: int | None = 0
    stamped: int | None = None
    is_blind: bool = False

    @property
    def is_certain(self) -> bool:
        """Whether only one answer is possible."""
        return self.low == self.high and not self.is_blind

    def settle(self, missed: int) -> None:
        """It is so many."""
        self.low = self.high = self.best = self.agreed = missed
        self.by_rule, self.why = True, ""

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
            extras *= not was_clear  # else they are glitches
            return replace(
                self,
                low=self.low + stamped - extras,
                extras=self.extras + extras,
                high=self.high + stamped,
                best=self.best + stamped,
                agreed=self.agreed + stamped,
                why=self.why * (not was_clear),
            )
        if counted is None and stamped is None:
            why = self.why or "neither a count nor a timestamp shows which triggers were missed"
            low, extras = self.low - extras, self.extras + extras
            return replace(self, low=low, high=NOWHERE, extras=extras, by_rule=False, why=why)
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
                why = "a timestamp shows missed triggers, and no counter confirms it"
        return replace(
            self,
            low=self.low - extras,
            high=high,
            best=best,
            extras=self.extras + extras,
            by_rule=self.by_rule or was_clear,
            why=why,
        )
