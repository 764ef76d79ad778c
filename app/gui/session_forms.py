"""Forms for what is done with one recorded session: a further analysis, and an export."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path

from PySide6.QtCore import Signal
from PySide6.QtWidgets import QComboBox, QLineEdit, QWidget

from analysis.settings import PRESETS
from app.files.kinds import EXPORTS
from app.gui.background import BackgroundWork
from app.gui.number_boxes import CountBox
from app.gui.widgets import STRETCH, Editors, Panel, button, form, label, row, widget, write
from app.runs.run_source import RunSource
from app.session.files import next_free

AS_RECORDED = "as recorded"
MOST_PX = 200  # of a box, and of the pitch of boxes
BETWEEN = re.compile(r"\s+(?=\w+\.[\w.]+\s*=)")  # settings: there may be spaces in a value


class SessionForm(Panel):
    """What is to be done with a recorded session, and which file comes of it.

    Parameters
    ----------
    title : str
        With the name of the session in place of ``{}``.
    act : str
        What the button does, as Enter in one of the lines does.
    """

    def __init__(self, title: str, act: str, rows: Editors, *more: QWidget) -> None:
        super().__init__()
        self.session: Path | None = None
        self._title, self._background = title, BackgroundWork(self)
        self.heading = label("", "heading", is_cut=True)
        self.where = label("", "muted", wraps=True)
        self.file, self.begin_button = QLineEdit(), button(act, act=self._ask)
        fields = form({**rows, "file": self.file})
        buttons = row(self.begin_button, *more, STRETCH, spacing=4)
        self.hold(self.heading, fields, self.where, buttons)
        for line in (one for one in (*rows.values(), self.file) if isinstance(one, QLineEdit)):
            line.returnPressed.connect(self._ask)
        self.hide()

    def show_session(self, session: Path) -> None:
        """Ask for what is to be done with this session."""
        if session != self.session:
            self.session = session
            self._head(session)
            self._propose()

    def _head(self, session: Path) -> None:
        """Say what is asked for."""
        write(self.heading, self._title.format(session.name))

    def end(self) -> None:
        """Ask for the next of the session that is chosen by now, once it is done."""
        session, self.session = self.session, None
        self.setEnabled(True)
        if session is not None:
            self.show_session(session)

    def _propose(self) -> None:
        """Propose a file that there is not yet."""
        raise NotImplementedError

    def _ask(self) -> None:
        """Have it done, if the file has a name."""
        raise NotImplementedError

    def _put_free(self, wanted: str, free: Callable[[], str]) -> None:
        """Propose a file at once, and the free one that is looked for unless another is typed."""
        self.file.setText(wanted)
        self._background.start_anew(
            free,
            lambda name: self.file.setText(name) if self.file.text() == wanted else None,
            self.where.setText,
        )


class AnalysisForm(SessionForm):
    """Settings of a further analysis; what is left alone is as it was recorded."""

    asked = Signal(object, object, object)  # session, overrides, output

    def __init__(self) -> None:
        self._source: RunSource | None = None
        self.doing = ""  # what goes on, in words
        self.preset = widget(QComboBox, toolTip="A set of settings of the correlation")
        self.preset.addItems([AS_RECORDED, *PRESETS])
        self.box, self.step = _pixels("Side of the correlation box"), _pixels("Pitch of the boxes")
        self.others = widget(
            QLineEdit,
            placeholderText="table.key=value, e.g. stress.method=none",
            toolTip="Any other settings of the analysis, separated by spaces",
        )
        self.stop = button("Stop", act=self._stop)
        sizes = row((self.box, 1), label("step", "name"), (self.step, 1))
        rows: Editors = {"preset": self.preset, "box": sizes, "others": self.others}
        super().__init__("Analyse {} again", "Analyse", rows, self.stop)
        self.file.setToolTip("Name of the new file, which lies beside the session")
        self.file.textChanged.connect(self._show_where)
        self.stop.setEnabled(False)

    def overrides(self) -> list[str]:
        """The settings that differ, as ``table.key=value``."""
        given: dict[str, object] = dict(PRESETS.get(self.preset.currentText(), {}))
        given |= {key: px for key in ("box", "step") if (px := getattr(self, key).value())}
        others = filter(None, BETWEEN.split(self.others.text().strip()))
        return [*(f"dic.{key}={value}" for key, value in given.items()), *others]

    def begin(self, doing: str) -> None:
        """Show that an analysis goes on, as long as it does."""
        self.doing = doing
        write(self.heading, f"{doing} …")
        self.begin_button.setEnabled(False)

    def follow(self, source: RunSource) -> None:
        """Let Stop end this analysis."""
        self._source = source
        self.stop.setEnabled(True)

    def end(self) -> None:
        """Show that it is over, and ask for the next."""
        self._source, self.doing = None, ""
        super().end()
        self.begin_button.setEnabled(True)
        self.stop.setEnabled(False)

    def _head(self, session: Path) -> None:
        if not self.doing:  # which Stop ends
            super()._head(session)

    def _propose(self) -> None:
        assert self.session is not None
        wanted = self.session.with_stem(f"{self.session.stem}-analysis")
        self._put_free(wanted.name, lambda: next_free(wanted).name)

    def _output(self) -> Path | None:
        """The file that is named; None where that is no name of a file."""
        name = self.file.text().strip()
        is_name = (
            name not in ("", "..") and name == Path(name).name and not set(name) & set("/\\\0")
        )
        return self.session.with_name(name) if self.session and is_name else None

    def _show_where(self) -> None:
        output, name = self._output(), self.file.text().strip()
        self.begin_button.setEnabled(output is not None and not self.doing)
        refusal = f"{name} is no name of a file; the new file lies beside the session"
        self.where.setText(str(output.absolute()) if output else refusal if name else "")

    def _ask(self) -> None:
        output = self._output()
        if output is not None and self.begin_button.isEnabled():
            self.asked.emit(self.session, self.overrides(), output)

    def _stop(self) -> None:
        if self._source is not None:
            self._source.request_stop("the operator ended the analysis")


class ExportForm(SessionForm):
    """What of a session is to be written, and where."""

    asked = Signal(object, object, str, str)  # session, destination, what, frames

    def __init__(self) -> None:
        policy = QComboBox.SizeAdjustPolicy.AdjustToMinimumContentsLengthWithIcon
        self.kind = widget(QComboBox, sizeAdjustPolicy=policy, minimumContentsLength=18)
        self.kind.addItems(
            [f"{one.what} ({one.ending or 'folder'}): {one.meaning}" for one in EXPORTS]
        )
        self.frames = widget(
            QLineEdit,
            placeholderText="all; or first:end:step",
            toolTip="Numbers of frames as recorded, the end not included; or one number",
        )
        super().__init__("Export {}", "Write", {"what": self.kind, "frames": self.frames})
        self.file.setToolTip("File or folder to write; it must not exist yet")
        self.kind.currentIndexChanged.connect(self._propose)

    def _propose(self) -> None:
        if self.session is not None:
            one, base = EXPORTS[self.kind.currentIndex()], self.session.absolute()
            wanted = base.with_name(f"{base.stem}-{one.what}{one.ending}")
            self._put_free(str(wanted), lambda: str(_free(wanted, one.ending)))

    def _ask(self) -> None:
        text = self.file.text().strip()
        if self.session is not None and text:
            what = EXPORTS[self.kind.currentIndex()].what
            destination = self.session.absolute().parent / text
            self.asked.emit(self.session, destination, what, self.frames.text().strip())


def _pixels(tip: str) -> CountBox:
    """A field for a number of pixels, empty as long as it is as recorded."""
    return widget(
        CountBox, maximum=MOST_PX, specialValueText=AS_RECORDED, suffix=" px", toolTip=tip
    )


def _free(path: Path, ending: str) -> Path:
    """This path, or with a number before its ending, of which there is no file."""
    free, number = path, 1
    while free.exists():
        number += 1
        free = path.with_name(f"{path.name.removesuffix(ending)}-{number}{ending}")
    return free
