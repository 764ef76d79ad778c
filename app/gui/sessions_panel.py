"""Recorded sessions: open, drop, recent; those of a folder; compare, analyse again, export."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from pathlib import Path

from PySide6.QtCore import Qt
from PySide6.QtGui import QBrush, QColor, QDragEnterEvent, QDropEvent, QKeyEvent, QShowEvent
from PySide6.QtWidgets import (
    QAbstractItemView,
    QFileDialog,
    QHeaderView,
    QMenu,
    QProgressBar,
    QPushButton,
    QTreeWidget,
    QTreeWidgetItem,
    QWidget,
)

from app.gui import theme
from app.gui.background import BackgroundWork
from app.gui.cells import DASH, Tone, typeset
from app.gui.comparison_view import ComparisonView
from app.gui.desk import Desk
from app.gui.file_question import SESSION_FILES, ask_file
from app.gui.memory import WindowMemory
from app.gui.session_forms import AnalysisForm, ExportForm
from app.gui.widgets import STRETCH, EmptyNote, Panel, column, label, row
from app.records.record_types import End
from app.replay import archive
from app.report.side_by_side import BEING_RECORDED, CUT_SHORT, Entry, Recorded
from app.runs.run_source import RunSource
from app.session.files import next_free

HEADS = ("session", "state", "P (N)", "μₛ", "recorded")
STATE_TONES = {
    End.COMPLETE: Tone.GOOD,
    End.IMPORTED: Tone.GOOD,
    End.STOPPED: Tone.WARN,
    End.FAILED: Tone.BAD,
    CUT_SHORT: Tone.BAD,
    BEING_RECORDED: Tone.BUSY,
}
PATH = Qt.ItemDataRole.UserRole


class SessionList(QTreeWidget):
    """Sessions of a folder; Enter plays the one that is chosen."""

    def __init__(self, play: Callable[[], object]) -> None:
        super().__init__()
        self._play = play
        self._entries: dict[Path, Entry] = {}
        self._by_path: dict[Path, QTreeWidgetItem] = {}
        self.setHeaderLabels(list(HEADS))
        self.setRootIsDecorated(False)
        self.setUniformRowHeights(True)
        self.setSelectionMode(QAbstractItemView.SelectionMode.ExtendedSelection)
        self.setAccessibleName("Sessions of the folder")
        header = self.header()
        header.setSectionResizeMode(QHeaderView.ResizeMode.ResizeToContents)
        header.setStretchLastSection(True)
        self.itemDoubleClicked.connect(lambda *_: play())

    def keyPressEvent(self, event: QKeyEvent) -> None:
        """Play on Enter."""
        if event.key() in (Qt.Key.Key_Return, Qt.Key.Key_Enter):
            self._play()
        else:
            super().keyPressEvent(event)

    def fill(self, paths: list[Path]) -> None:
        """List files of which nothing is known yet."""
        self.clear()
        self._entries.clear()
        self._by_path.clear()
        for path in paths:
            item = QTreeWidgetItem([path.name, "…", "", "", ""])
            item.setData(0, PATH, path)
            item.setToolTip(0, str(path))
            self.addTopLevelItem(item)
            self._by_path[path] = item

    def show_entry(self, entry: Entry) -> None:
        """Show what is known of a file by now."""
        self._entries[entry.path] = entry
        item = self._by_path.get(entry.path)
        if item is None:
            return
        when = entry.started[:16].replace("T", " ")
        mu = typeset(entry.mu_s).replace(" to ", "–") or DASH
        for k, text in enumerate(
            (entry.state or "not readable", entry.load_n or DASH, mu, when), 1
        ):
            item.setText(k, text)
        item.setToolTip(1, entry.problem or entry.state)
        tone = STATE_TONES.get(entry.state, Tone.NEUTRAL if entry.state else Tone.BAD)
        item.setForeground(1, QBrush(QColor(theme.TONES[tone])))

    def entry(self, path: Path) -> Entry | None:
        """What is known of a file; None if that is nothing yet."""
        return self._entries.get(path)

    def chosen(self) -> list[Path]:
        """The files that are selected, from above."""
        return [item.data(0, PATH) for item in self._items() if item.isSelected()]

    def _items(self) -> list[QTreeWidgetItem]:
        items = map(self.topLevelItem, range(self.topLevelItemCount()))
        return [item for item in items if item is not None]

    def choose(self, paths: list[Path]) -> None:
        """Select these files."""
        for item in self._items():
            item.setSelected(item.data(0, PATH) in paths)
            if item.isSelected():
                self.setCurrentItem(item, 0, self.selectionModel().SelectionFlag.NoUpdate)


class SessionsPanel(Panel):
    """Finds recorded sessions and does with them whatever the commands do.

    Nothing is read in the thread of the window.
    """

    name, title = "sessions", "Sessions"
    keys = (("Enter", "Plays the session that is chosen in the list."),)

    def __init__(self, desk: Desk) -> None:
        super().__init__()
        self._desk, self._memory = desk, WindowMemory()
        self._background = BackgroundWork(self)
        self._folder: Path | None = None
        self._listing = 0  # late answers of an earlier one are dropped
        self._dialog: QFileDialog | None = None
        # by path, with the time of its last change: a file that is as it was is not read again
        self._read: dict[Path, tuple[float, Entry]] = {}
        self.comparisons: list[ComparisonView] = []
        self.open, self.folder = QPushButton("Open …"), QPushButton("Folder …")
        self.recent = QPushButton("Recent")
        self.list = SessionList(self.play)
        EmptyNote(
            self.list,
            "Recorded sessions of a folder, to be played, compared, analysed again and exported",
        )
        self.play_button, self.compare_button = QPushButton("Play"), QPushButton("Compare")
        self.analyse, self.export = QPushButton("Analyse again …"), QPushButton("Export …")
        self.where = label("Drop a session or a folder here.", "muted")
        self.said = label("", "muted")
        for words in (self.where, self.said):
            words.setWordWrap(True)
            words.setTextInteractionFlags(Qt.TextInteractionFlag.TextSelectableByMouse)
        self.bar = QProgressBar()
        self.bar.setTextVisible(False)
        self.bar.setFixedHeight(8)
        self.bar.hide()
        self.analysis_form, self.export_form = AnalysisForm(), ExportForm()
        self.recent.setMenu(self.recent_menu(self.recent))
        for button, tip in (
            (self.open, "Plays a recorded session, and lists those beside it"),
            (self.folder, "Lists the sessions of a folder"),
            (self.recent, "Sessions that were opened before"),
            (self.play_button, "Plays the session that is chosen (Enter)"),
            (self.compare_button, "Shows the chosen sessions side by side"),
            (self.analyse, "Analyses the chosen session with other settings, into a new file"),
            (self.export, "Writes the chosen session for other programs"),
        ):
            button.setToolTip(tip)
        self.setLayout(
            column(
                row(self.open, self.folder, self.recent, STRETCH, spacing=4),
                self.where,
                (self.list, 1),
                row((self.play_button, 1), (self.compare_button, 1), spacing=4),
                row((self.analyse, 1), (self.export, 1), spacing=4),
                self.analysis_form,
                self.export_form,
                self.bar,
                self.said,
                spacing=6,
                margins=(10, 8, 10, 8),
            )
        )
        self.setAcceptDrops(True)
        self.open.clicked.connect(self._ask_session)
        self.folder.clicked.connect(self._ask_folder)
        self.play_button.clicked.connect(self.play)
        self.compare_button.clicked.connect(self.compare)
        self.analyse.clicked.connect(self._toggle_analysis)
        self.export.clicked.connect(self._toggle_export)
        self.list.itemSelectionChanged.connect(self._show_buttons)
        self.analysis_form.asked.connect(self._analyse)
        self.export_form.asked.connect(self._export)
        self._desk.ended.connect(self._list_again)
        self._show_buttons()

    # ------------------------------------------------------------------ opening and listing

    def open_session(self, path: Path) -> None:
        """Play a recorded session, and list those beside it."""
        self._memory.remember("session", path)
        self._desk.session_asked.emit(path)
        self.list_folder(path.parent, [path])

    def list_folder(self, folder: Path, chosen: list[Path] | None = None) -> None:
        """List the sessions of a folder from now on, and select some."""
        self._folder = folder
        self._list(folder, chosen)

    def _list(self, folder: Path, chosen: list[Path] | None = None) -> None:
        self._listing += 1
        number = self._listing
        self.where.setText(str(folder.absolute()))

        def show(paths: list[Path]) -> None:
            if number != self._listing:
                return
            self.list.fill(paths)
            self.list.choose(chosen or paths[:1])
            if not paths:
                self._say(f"{folder.absolute()}: there are no sessions in this folder.")
            self._background.start(lambda: read(paths), lambda _: None, self._say)

        def read(paths: list[Path]) -> None:
            for path in paths:
                if number != self._listing:
                    return
                self._background.tell(partial(take, self._entry_of(path)))

        def take(entry: Entry) -> None:
            if number == self._listing:
                self.list.show_entry(entry)
                self._show_buttons()

        self._background.start(lambda: archive.sessions_in(folder), show, self._say)

    def _entry_of(self, path: Path) -> Entry:
        """What the list says of a file; in any thread."""
        changed = path.stat().st_mtime if path.exists() else 0.0
        at, known = self._read.get(path, (0.0, None))
        if known is None or at != changed or known.problem:
            known = archive.entry_of(path)
            self._read[path] = changed, known
        return known

    def showEvent(self, event: QShowEvent) -> None:
        """List the folder of the next run, as long as no other was chosen."""
        super().showEvent(event)
        if self._folder is None:
            self._list(self._desk.session.parent if self._desk.session else Path())

    def play(self) -> None:
        """Play the session that is chosen, or bring back one that was cut short."""
        for path in self.list.chosen()[:1]:
            if self._is_cut_short(path):
                self._repair(path)
                return
            self._memory.remember("session", path)
            self._desk.session_asked.emit(path)

    def _is_cut_short(self, path: Path) -> bool:
        entry = self.list.entry(path)
        return entry is not None and entry.state == CUT_SHORT

    def _repair(self, session: Path) -> None:
        self.bar.setRange(0, 1000)
        self.bar.setValue(0)
        self.bar.show()
        self._say(f"{session.name} is being brought back …")

        def tell(share: float) -> None:
            self._background.tell(partial(self.bar.setValue, round(1000 * share)))

        def repaired() -> tuple[Path, str]:
            from app.session.repair import repair

            output = next_free(session.with_stem(f"{session.stem}-repaired"))
            return output, str(repair(session, output, progress=tell))

        def done(found: tuple[Path, str]) -> None:
            output, sentence = found
            self.bar.hide()
            self._say(sentence)
            self.list_folder(output.parent, [output])

        def failed(sentence: str) -> None:
            self.bar.hide()
            self._say(sentence, is_alarm=True)

        self._background.start(repaired, done, failed)

    def dragEnterEvent(self, event: QDragEnterEvent) -> None:
        """Files and folders of this computer may be dropped."""
        if any(url.isLocalFile() for url in event.mimeData().urls()):
            event.acceptProposedAction()

    def dropEvent(self, event: QDropEvent) -> None:
        """Open a session or list a folder; of several sessions, list and select them."""
        paths = [Path(url.toLocalFile()) for url in event.mimeData().urls() if url.isLocalFile()]
        event.acceptProposedAction()

        def open_dropped(is_folder: bool) -> None:
            if is_folder:
                self.list_folder(paths[0])
            elif len(paths) == 1:
                self.open_session(paths[0])
            else:
                self.list_folder(paths[0].parent, paths)

        if paths:
            self._background.start(paths[0].is_dir, open_dropped, self._say)

    def _list_again(self, source: RunSource) -> None:
        """List the folder as it is after a run; that of the run, if none was listed before."""
        session: Path | None = getattr(source, "session", None)
        if session is not None:
            self._memory.remember("session", session)
        if self._folder is not None:
            self.list_folder(self._folder, self.list.chosen())
        elif session is not None:
            self.list_folder(session.parent, [session])

    def _ask_session(self) -> None:
        self._ask("Open a session", QFileDialog.FileMode.ExistingFile, self.open_session)

    def _ask_folder(self) -> None:
        self._ask("Sessions of a folder", QFileDialog.FileMode.Directory, self.list_folder)

    def _ask(self, title: str, mode: QFileDialog.FileMode, act: Callable[[Path], None]) -> None:
        kinds = "" if mode is QFileDialog.FileMode.Directory else SESSION_FILES
        start = self._folder or Path.cwd()
        self._dialog = ask_file(self, title, act, start=start, kinds=kinds, mode=mode)

    def recent_menu(self, parent: QWidget) -> QMenu:
        """A menu of the sessions that were opened or recorded last."""
        menu = QMenu("&Recent sessions", parent)

        def fill() -> None:
            menu.clear()
            for path in self._memory.recent("session"):
                menu.addAction(str(path)).triggered.connect(
                    lambda _=False, path=path: self.open_session(path)
                )
            if menu.isEmpty():
                menu.addAction("No session was opened yet").setEnabled(False)

        menu.aboutToShow.connect(fill)
        return menu

    # ------------------------------------------------------------------ side by side

    def compare(self) -> None:
        """Show the chosen sessions side by side."""
        self._compare(self.list.chosen())

    def _compare(self, paths: list[Path], said: str = "") -> None:
        """Show sessions side by side, and say something once that is done."""
        self._say(f"Reading {', '.join(path.name for path in paths)} …")
        self._background.start(
            lambda: [archive.recorded(path) for path in paths],
            lambda sessions: self._show_comparison(sessions, said),
            self._say,
        )

    def _show_comparison(self, sessions: list[Recorded], said: str) -> None:
        self.comparisons = [view for view in self.comparisons if view.isVisible()]
        view = ComparisonView(sessions, self)
        self.comparisons.append(view)
        view.show()
        self._say(said)

    # ------------------------------------------------------------------ further analyses

    def _toggle_analysis(self) -> None:
        self.export_form.hide()
        self.analysis_form.setVisible(not self.analysis_form.isVisible())
        self._show_buttons()

    def _analyse(self, session: Path, overrides: list[str], output: Path) -> None:
        """Analyse a session again in threads of its own, then show both side by side.

        Not during a run, whose analysis needs the cores.
        """
        if self._desk.is_live:
            self._say(
                f"{session.name} was not analysed again: a run is going on, and its own analysis"
                " needs the processor; begin once the run has ended."
            )
            return
        form = self.analysis_form
        form.begin(f"{session.name} is being analysed again …")
        self.bar.setRange(0, 1000)
        self.bar.setValue(0)
        self.bar.show()

        def failed(sentence: str) -> None:
            form.end()
            self.bar.hide()
            self._say(sentence, is_alarm=True)

        def follow() -> str:
            source = self._desk.factory.reanalysis(session, overrides, output)
            self._background.tell(lambda: form.follow(source))
            source.start()
            while (outcome := (now := source.look()).outcome) is None:
                share = now.health.progress
                self._background.tell(partial(self.bar.setValue, round(1000 * share)))
                self._background.pause()
            if outcome.state != "done":
                raise RuntimeError(outcome.reason)
            return outcome.reason

        def done(reason: str) -> None:
            form.end()
            self.bar.hide()
            self._compare([session, output], f"{output.absolute()}: {reason}")
            self.list_folder(output.parent, [session, output])

        self._background.start(follow, done, failed)

    # ------------------------------------------------------------------ export

    def _toggle_export(self) -> None:
        self.analysis_form.hide()
        self.export_form.setVisible(not self.export_form.isVisible())
        self._show_buttons()

    def _export(self, session: Path, destination: Path, what: str, frames: str) -> None:
        form = self.export_form
        form.setEnabled(False)
        self.bar.setRange(0, 1000)
        self.bar.show()

        def tell(text: str, share: float) -> None:
            self._background.tell(lambda: self.bar.setValue(round(1000 * share)))

        def over(sentence: str, is_alarm: bool) -> None:
            form.setEnabled(True)
            self.bar.hide()
            self._say(sentence, is_alarm=is_alarm)
            form.show_session(session)

        def written() -> str:
            from app.files.exporting import export  # it would hold up the window at its start

            return export(session, destination, what, frames=frames, on_progress=tell)

        self._background.start(
            written,
            lambda sentence: over(f"Written: {sentence}", False),
            lambda sentence: over(sentence, True),
        )

    # ------------------------------------------------------------------ what is possible

    def _show_buttons(self) -> None:
        chosen = self.list.chosen()
        one = chosen[0] if len(chosen) == 1 else None
        for button in (self.play_button, self.analyse, self.export):
            button.setEnabled(one is not None)
        is_cut_short = one is not None and self._is_cut_short(one)
        self.play_button.setText("Repair" if is_cut_short else "Play")
        if is_cut_short:
            for button in (self.analyse, self.export):
                button.setEnabled(False)
            known = self.list.entry(chosen[0])
            self._say(known.problem if known else "")
        self.compare_button.setEnabled(len(chosen) >= 2)
        if one is not None and self.analysis_form.isVisible():
            self.analysis_form.show_session(one)
        if one is not None and self.export_form.isVisible():
            self.export_form.show_session(one)

    def _say(self, sentence: str, *, is_alarm: bool = False) -> None:
        self.said.setText(typeset(sentence))
        colour = theme.TONES[Tone.BAD if is_alarm else Tone.NEUTRAL]
        self.said.setStyleSheet(f"color: {colour};")
        if is_alarm:
            self._desk.said.emit(sentence, False)
