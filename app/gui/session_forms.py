"""Forms for what is done with one recorded session: a further analysis, and an export."""

from __future__ import annotations

import shlex
from pathlib import Path

from PySide6.QtCore import Signal
from PySide6.QtWidgets import QComboBox, QLineEdit, QPushButton, QSpinBox

from analysis.settings import PRESETS
from app.files.kinds import EXPORTS
from app.gui.background import BackgroundWork
from app.gui.widgets import STRETCH, Panel, column, label, row
from app.runs.run_source import RunSource
from app.session.files import next_free

AS_RECORDED = "as recorded"


class AnalysisForm(Panel):
    """Settings of a further analysis; what is left alone is as it was recorded."""

    asked = Signal(object, object, object)  # session, overrides, output

    def __init__(self) -> None:
        super().__init__()
        self._session: Path | None = None
        self._source: RunSource | None = None
        self._background = BackgroundWork(self)
        self.preset, self.box, self.step = QComboBox(), QSpinBox(), QSpinBox()
        self.preset.addItems([AS_RECORDED, *PRESETS])
        self.preset.setToolTip("A set of settings of the correlation")
        for spin, most, tip in (
            (self.box, 200, "Side of the correlation box"),
            (self.step, 200, "Pitch of the grid of boxes"),
        ):
            spin.setRange(0, most)
            spin.setSpecialValueText(AS_RECORDED)
            spin.setSuffix(" px")
            spin.setToolTip(tip)
        self.others, self.file = QLineEdit(), QLineEdit()
        self.others.setPlaceholderText("table.key=value, e.g. stress.method=none")
        self.others.setToolTip("Any other settings of the analysis, separated by spaces")
        self.file.setToolTip("Name of the new file, which lies beside the session")
        self.begin_button, self.stop = QPushButton("Analyse"), QPushButton("Stop")
        self.what, self.where = label("", "heading"), label("", "muted")
        self.where.setWordWrap(True)
        self.stop.setEnabled(False)
        self.setLayout(
            column(
                self.what,
                row(label("preset", "name"), (self.preset, 1), spacing=6),
                row(
                    *(label("box", "name"), (self.box, 1), label("step", "name"), (self.step, 1)),
                    spacing=6,
                ),
                row(label("others", "name"), (self.others, 1), spacing=6),
                row(label("file", "name"), (self.file, 1), spacing=6),
                self.where,
                row(self.begin_button, self.stop, STRETCH, spacing=4),
                spacing=5,
                margins=(8, 6, 8, 6),
            )
        )
        self.begin_button.clicked.connect(self._ask)
        self.others.returnPressed.connect(self._ask)
        self.file.returnPressed.connect(self._ask)
        self.file.textChanged.connect(self._show_where)
        self.stop.clicked.connect(self._stop)
        self.hide()

    def show_session(self, session: Path) -> None:
        """Ask for settings of this session."""
        if session != self._session:
            self._session = session
            self.what.setText(f"Analyse {session.name} again")
            name = session.with_stem(f"{session.stem}-analysis").name
            self.file.setText(name)
            self._background.start_anew(
                lambda: next_free(session.with_name(name)).name,
                lambda free: self.file.setText(free) if self.file.text() == name else None,
                self.where.setText,
            )

    def overrides(self) -> list[str]:
        """The settings that differ, as ``table.key=value``."""
        given: dict[str, object] = dict(PRESETS.get(self.preset.currentText(), {}))
        given |= {key: spin.value() for key, spin in self._spins() if spin.value()}
        return [f"dic.{key}={value}" for key, value in given.items()] + shlex.split(
            self.others.text(), posix=False
        )

    def begin(self, sentence: str) -> None:
        """Show that an analysis goes on."""
        self.what.setText(sentence)
        self.begin_button.setEnabled(False)

    def follow(self, source: RunSource) -> None:
        """Let Stop end this analysis."""
        self._source = source
        self.stop.setEnabled(True)

    def end(self) -> None:
        """Show that it is over, and ask for the next."""
        self._source = self._session = None
        self.begin_button.setEnabled(True)
        self.stop.setEnabled(False)

    def _spins(self) -> tuple[tuple[str, QSpinBox], ...]:
        return ("box", self.box), ("step", self.step)

    def _output(self) -> Path | None:
        """The file that is named; None where that is no name of a file."""
        name = self.file.text().strip()
        is_name = (
            name not in ("", "..") and name == Path(name).name and not set(name) & set("/\\\0")
        )
        return self._session.with_name(name) if self._session and is_name else None

    def _show_where(self) -> None:
        output, name = self._output(), self.file.text().strip()
        self.begin_button.setEnabled(output is not None and self._source is None)
        if output is not None:
            self.where.setText(str(output.absolute()))
        elif name:
            self.where.setText(f"{name} is no name of a file; the new file lies beside the session")

    def _ask(self) -> None:
        output = self._output()
        if output is not None and self.begin_button.isEnabled():
            self.asked.emit(self._session, self.overrides(), output)

    def _stop(self) -> None:
        if self._source is not None:
            self._source.request_stop("the operator ended the analysis")


def _free(path: Path, ending: str) -> Path:
    """This path, or with a number before its ending, of which there is no file."""
    free, number = path, 1
    while free.exists():
        number += 1
        free = path.with_name(f"{path.name.removesuffix(ending)}-{number}{ending}")
    return free


class ExportForm(Panel):
    """What of a session is to be written, and where."""

    asked = Signal(object, object, str, str)  # session, destination, what, frames

    def __init__(self) -> None:
        super().__init__()
        self._session: Path | None = None
        self._background = BackgroundWork(self)
        self.what, self.kind = label("", "heading"), QComboBox()
        self.frames, self.file = QLineEdit(), QLineEdit()
        self.frames.setPlaceholderText("all; or first:end:step")
        self.frames.setToolTip("Numbers of frames as recorded, the end not included; or one number")
        self.file.setToolTip("File or folder to write; it must not exist yet")
        self.write = QPushButton("Write")
        self.setLayout(
            column(
                self.what,
                row(label("what", "name"), (self.kind, 1), spacing=6),
                row(label("frames", "name"), (self.frames, 1), spacing=6),
                row(label("to", "name"), (self.file, 1), spacing=6),
                row(self.write, STRETCH),
                spacing=5,
                margins=(8, 6, 8, 6),
            )
        )
        self.kind.setSizeAdjustPolicy(
            QComboBox.SizeAdjustPolicy.AdjustToMinimumContentsLengthWithIcon
        )
        self.kind.setMinimumContentsLength(18)
        self.kind.currentIndexChanged.connect(self._show_file)
        self.write.clicked.connect(self._ask)
        self.file.returnPressed.connect(self._ask)
        self.frames.returnPressed.connect(self._ask)
        self.hide()

    def show_session(self, session: Path) -> None:
        """Ask what of this session is to be written."""
        if not self.kind.count():
            for one in EXPORTS:
                form = one.ending or "folder"
                self.kind.addItem(f"{one.what} ({form}): {one.meaning}")
        self._session = session
        self.what.setText(f"Export {session.name}")
        self._show_file()

    def _show_file(self) -> None:
        if self._session is None or self.kind.currentIndex() < 0:
            return
        one, base = EXPORTS[self.kind.currentIndex()], self._session.absolute()
        wanted = base.with_name(f"{base.stem}-{one.what}{one.ending}")
        self.file.setText(str(wanted))
        self._background.start_anew(
            lambda: str(_free(wanted, one.ending)),
            lambda free: self.file.setText(free) if self.file.text() == str(wanted) else None,
            self.file.setToolTip,
        )

    def _ask(self) -> None:
        text = self.file.text().strip()
        if self._session is not None and text:
            what = EXPORTS[self.kind.currentIndex()].what
            destination = self._session.absolute().parent / text
            self.asked.emit(self._session, destination, what, self.frames.text().strip())
