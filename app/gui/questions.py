"""What the window asks in its line, beside which it stays in use."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial

from PySide6.QtCore import Qt
from PySide6.QtWidgets import QInputDialog, QWidget

from app.gui.background import Act, Take
from app.gui.notice import Notice
from app.gui.widgets import widget


def ask_to_close(notice: Notice, stop: Act, leave: tuple[str, Act], *, is_made: bool) -> None:
    """Ask what is to become of a run whose window is closed.

    Parameters
    ----------
    stop : callable
        Stops it, or calls it off, and closes.
    leave : tuple
        Name of the bench in a process of its own, with which the run can go on; empty where it
        has none. And what closes the window without it.
    is_made : bool
        Whether it is still being made.
    """
    if is_made:
        notice.ask("A run is being made ready.", "Call it off and close", stop, no="Let it begin")
        return
    name, act = leave
    more = f" It records on without a window: the next one, or slipscope attach {name}, shows it."
    notice.ask(
        f"A run is going on.{more * bool(name)}",
        "Stop the motion and close",
        stop,
        other="Let it go on and close" * bool(name),
        on_other=act,
    )


def offer_run(notice: Notice, runs: Sequence[tuple[str, str]], show: Take) -> None:
    """Offer to show a run that goes on without a window, the newest of some, given by their names
    and what they are.
    """
    name, what = runs[-1]
    others = f" (and {len(runs) - 1} more)" * (len(runs) > 1)
    notice.ask(
        f"A run of yours is under way: {what}{others}. STOP MOTION stops it from here, too.",
        "Show it",
        partial(show, name),
        no="Not now",
    )


def ask_note(window: QWidget, take: Take) -> None:
    """Ask for a note of the run in a window of its own, and take its text."""
    about = {"windowTitle": "Note", "labelText": "What happens now:"}
    dialog = widget(QInputDialog, window, textValueSelected=take, **about)
    dialog.setAttribute(Qt.WidgetAttribute.WA_DeleteOnClose)
    dialog.show()


def unexpected(what: str) -> str:
    """The sentence for an error that nobody has expected."""
    return (
        f"Something in the program went wrong ({what}): what was asked last may not have been"
        " done. STOP MOTION still works, a run goes on, and the log has the details."
    )
