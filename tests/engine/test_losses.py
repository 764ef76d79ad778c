"""Losses are told by their reasons, as long as there are few of them or many."""

from app.acquisition.losses import MOST_LISTED, Losses


def test_reasons_that_differ_by_their_numbers_are_one() -> None:
    losses = Losses()
    assert str(losses) == ""
    for number in range(500):
        losses.add(f"camera 'top': trigger {number} came {number / 8:.3f} s late")
    losses.add("samples were overwritten", 40)
    told = str(losses)
    assert told.startswith("500 × camera 'top': trigger 499 came 62.375 s late; 40 × samples")
    for letter in "abcdef":
        losses.add(f"reason {letter}")
    assert str(losses).count("×") == MOST_LISTED
