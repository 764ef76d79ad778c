"""A bit of the journal that the disk has changed costs no frame, and no more samples than its
record holds.
"""

from __future__ import annotations

import pytest
from damaged_journal import BLOCK, DamagedJournal


@pytest.fixture(scope="module")
def killed(tmp_path_factory: pytest.TempPathFactory) -> DamagedJournal:
    """A killed session of 213 frames."""
    return DamagedJournal(tmp_path_factory.mktemp("killed"))


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(8))
def test_all_frames_come_back_whichever_bit_was_flipped(killed: DamagedJournal, seed: int) -> None:
    frames, samples = killed.lost_by_bit(seed)
    assert frames == 0
    assert samples in (0, BLOCK)
