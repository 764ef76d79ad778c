"""Recorded sessions: open, drop, recent; those of a folder; compare, analyse again, export."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import Any

from PySide6.QtCore import QTimer
from PySide6.QtGui import QDragEnterEvent, QDropEvent, QShowEvent
from PySide6.QtWidgets import (
    QAbstractItemView,
    QFileDialog,
    QMenu,
    QWidget,
)

from app.gui.background import Act, BackgroundWork, Take
from app.gui.cells import DASH, Tone, tone_of, typeset
from app.gui.comparison_view import ComparisonView
from app.gui.file_question import SESSION_FILES, ask_file
from app.gui.memory import WindowMemory
from app.gui.session_forms import AnalysisForm, ExportForm, SessionForm
from app.gui.widgets import (
    STRETCH,
    Panel,
    RowList,
    button,
    fill_bar,
    progress_bar,
    row,
    tint,
    words,
)
from app.gui.window_model import WindowModel
from app.replay import archive
from app.report.side_by_side import BEING_RECORDED, CUT_SHORT, Entry, Recorded
from app.session.files import next_free
from app.system.progress import ShareDone

LOOK_S = 0.1  # between two looks at a further analysis
AGAIN_MS = 2000  # between two at a session that is being recorded
HEADS = ("session", "state", "P (N)", "μₛ", "recorded")


class SessionList(RowList):
    """Sessions of a folder; Enter or a double click plays the one that is chosen."""

    def __init__(self) -> None:
        super().__init__(
            HEADS,
            "Sessions of the folder",
            "Recorded sessions of a folder, to be played, compared, analysed again and exported",
            selectionMode=QAbstractItemView.SelectionMode.ExtendedSelection,
        )
        self._rows: dict[Path, int] = {}

    def fill(self, paths: Sequence[Path]) -> None:
        """List files of which nothing is known yet."""
        self.clear()
        self._rows = {path: at for at, path in enumerate(dict.fromkeys(paths))}
        for path, at in self._rows.items():
            self.put_row(at, (path.name, "…", "", "", ""), {0: str(path)}, {})

    def show_entry(self, entry: Entry) -> None:
        """Show what is known of a file by now."""
        if entry.path not in self._rows:
            return
        when = entry.started[:16].replace("T", " ")
        mu = typeset(entry.mu_s).replace(" to ", "–") or DASH
        texts = (
            entry.path.name,
            entry.state or "not readable",
            typeset(entry.load_n) or DASH,
            mu,
            when,
        )
        tips = {0: str(entry.path), 1: entry.problem or entry.state}
        is_bad = entry.state in ("", CUT_SHORT)
        tone = Tone.BAD if is_bad else tone_of(entry.state)
        self.put_row(self._rows[entry.path], texts, tips, {1: tone})

    def chosen(self) -> list[Path]:
        """The files that are selected, from above."""
        chosen = {index.row() for index in self.selectionModel().selectedRows()}
        return [path for path, row in self._rows.items() if row in chosen]

    def choose(self, paths: Sequence[Path]) -> None:
        """Select these files."""
        flags = self.selectionModel().SelectionFlag
        self.clearSelection()
        for path in paths:
            if path in self._rows:
                index = self.model().index(self._rows[path], 0)
                self.selectionModel().setCurrentIndex(index, flags.Select | flags.Rows)


class SessionsPanel(Panel):
    """Finds recorded sessions and does with them whatever the commands do.

    Nothing is read in the thread of the window.
    """

    name, title = "sessions", "Sessions"
    keys = (("Enter", "Plays the session that is chosen in the list."),)

    def __init__(self, model: WindowModel) -> None:
        super().__init__()
        self._model, self._memory = model, WindowMemory()
        self._background = BackgroundWork(self)
        self._folder: Path | None = None
        self._listing = 0  # late answers of an earlier one are dropped
        # by path, with the time of its last change: a file that is as it was is not read again
        self._read: dict[Path, tuple[float, Entry]] = {}
        self.list = SessionList()
        modes = QFileDialog.FileMode
        self.open = button(
            "Open …",
            "Plays a recorded session, and lists those beside it",
            partial(self._ask, "Open a session", modes.ExistingFile, self.open_session),
        )
        self.folder = button(
            "Folder …",
            "Lists the sessions of a folder",
            partial(self._ask, "Sessions of a folder", modes.Directory, self.list_folder),
        )
        self.recent = button("Recent", "Sessions that were opened before")
        self.recent.setMenu(recent_menu(self.recent, self._memory, self.open_session))
        self.play_button = button("Play", "Plays the session that is chosen (Enter)", self.play)
        self.compare_button = button(
            "Compare", "Shows the chosen sessions side by side", self.compare
        )
        self.analysis_form, self.export_form = AnalysisForm(), ExportForm()
        self.analyse = button(
            "Analyse again …",
            "Analyses the chosen session with other settings, into a new file",
            partial(self._toggle, self.analysis_form),
        )
        self.export = button(
            "Export …",
            "Writes the chosen session for other programs",
            partial(self._toggle, self.export_form),
        )
        self.where, self.said, self.bar = words("muted"), words("muted"), progress_bar()
        self.where.setText("Drop a session or a folder here.")
        self.bar.hide()
        files = row(self.open, self.folder, self.recent, STRETCH, spacing=4)
        first = row((self.play_button, 1), (self.compare_button, 1), spacing=4)
        second = row((self.analyse, 1), (self.export, 1), spacing=4)
        forms = (self.analysis_form, self.export_form)
        lists = (files, self.where, (self.list, 1), first, second)
        self.hold(*lists, *forms, self.bar, self.said)
        self.setAcceptDrops(True)
        self.list.itemActivated.connect(self.play)
        self.list.itemSelectionChanged.connect(self._show_buttons)
        self.analysis_form.asked.connect(self._analyse)
        self.export_form.asked.connect(self._export)
        self._model.ended.connect(lambda _: self._list_again(model.recorded))
        self._model.busy_changed.connect(self._name_analysis)
        self._show_buttons()

    @property
    def comparisons(self) -> list[ComparisonView]:
        """Those that are open."""
        return self.findChildren(ComparisonView)

    # ------------------------------------------------------------------ opening and listing

    def open_session(self, path: Path) -> None:
        """Play a recorded session, and list those beside it."""
        self._memory.remember("session", path)
        self._model.session_asked.emit(path)
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
                self.where.setText(f"{folder.absolute()}: there are no sessions in this folder.")
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
                if entry.state == BEING_RECORDED:
                    QTimer.singleShot(AGAIN_MS, self, partial(look_again, entry.path))

        def look_again(path: Path) -> None:
            if number == self._listing:
                self._background.start(lambda: self._entry_of(path), take, self._say)

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
        """List the folder of the last run, or of the next, as long as no other was chosen."""
        super().showEvent(event)
        if self._folder is None:
            self._list_again(self._model.recorded)
        if self._folder is None:
            self._list(self._model.session.parent if self._model.session else Path())

    def play(self) -> None:
        """Play the session that is chosen, or bring back one that was cut short."""
        for path in self.list.chosen()[:1]:
            if self._is_cut_short(path):
                self._repair(path)
                return
            self._memory.remember("session", path)
            self._model.session_asked.emit(path)

    def _is_cut_short(self, path: Path) -> bool:
        return path in self._read and self._read[path][1].state == CUT_SHORT

    def _start(
        self,
        work: Callable[[ShareDone], Any],
        done: Take,
        end: Act = lambda: None,
    ) -> None:
        """Do what takes a while, in a thread, and show how far it is.

        Parameters
        ----------
        work : callable
            Given what tells the share that is done.
        done : callable
            Given what `work` gave back; what it raised is said as an alarm.
        end : callable
            Is called first in either case.
        """
        fill_bar(self.bar, 0)
        self.bar.show()

        def tell(share: float) -> None:
            self._background.tell(partial(fill_bar, self.bar, share))

        def over(act: Take, result: Any) -> None:
            end()
            self.bar.hide()
            act(result)

        self._background.start(
            lambda: work(tell),
            partial(over, done),
            partial(over, partial(self._say, is_alarm=True)),
        )

    def _repair(self, session: Path) -> None:
        self._say(f"{session.name} is being brought back …")

        def repaired(tell: ShareDone) -> tuple[Path, str]:
            from app.session.repair import repair

            output = next_free(session.with_stem(f"{session.stem}-repaired"))
            return output, str(repair(session, output, progress=tell))

        def done(found: tuple[Path, str]) -> None:
            output, sentence = found
            self._say(sentence)
            self.list_folder(output.parent, [output])

        self._start(repaired, done)

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
            self._background.start_anew(paths[0].is_dir, open_dropped, self._say)

    def _list_again(self, session: Path | None) -> None:
        """List the folder as it is after a run; that of the run, if none was listed before."""
        if self._folder is not None:
            self.list_folder(self._folder, self.list.chosen())
        elif session is not None:
            self.list_folder(session.parent, [session])

    def _ask(self, title: str, mode: QFileDialog.FileMode, act: Take) -> None:
        kinds = "" if mode is QFileDialog.FileMode.Directory else SESSION_FILES
        ask_file(self, title, act, start=self._folder or Path.cwd(), kinds=kinds, mode=mode)

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
        ComparisonView(sessions, self).show()
        self._say(said)

    # ------------------------------------------------------------------ further analyses, export

    def _toggle(self, form: SessionForm) -> None:
        """Show a form, or hide it; the other is hidden."""
        for one in (self.analysis_form, self.export_form):
            one.setVisible(one is form and not one.isVisible())
        self._show_buttons()

    def _analyse(self, session: Path, overrides: list[str], output: Path) -> None:
        """Analyse a session again in threads of its own, then show both side by side.

        Not during a run, whose analysis needs the cores.
        """
        if self._model.is_live:
            self._say(
                f"{session.name} was not analysed again: a run is going on, and its own analysis"
                " needs the processor; begin once the run has ended."
            )
            return
        form = self.analysis_form
        form.begin(f"{session.name} is being analysed again")

        def follow(tell: ShareDone) -> str:
            source = self._model.factory.reanalysis(session, overrides, output)
            self._background.tell(lambda: form.follow(source))
            source.start()
            while (outcome := (now := source.look()).outcome) is None:
                tell(now.health.progress)
                time.sleep(LOOK_S)
            if outcome.state != "done":
                raise RuntimeError(outcome.reason)
            return outcome.reason

        def done(reason: str) -> None:
            self._compare([session, output], f"{output.absolute()}: {reason}")
            self.list_folder(output.parent, [session, output])

        self._start(follow, done, form.end)

    def _name_analysis(self) -> None:
        """Say that a run which begins shares the processor with a further analysis."""
        if self._model.is_live and (doing := self.analysis_form.doing):
            sentence = (
                f"{doing}, which takes processor time from the analysis of the run that begins;"
                " Stop in the dock Sessions ends it."
            )
            self._say(sentence)
            self._model.said.emit(sentence, False)

    def _export(self, session: Path, destination: Path, what: str, frames: str) -> None:
        form = self.export_form
        form.setEnabled(False)

        def written(tell: ShareDone) -> str:
            from app.files.exporting import export  # it would hold up the window at its start

            return export(
                session, destination, what, frames=frames, on_progress=lambda _, share: tell(share)
            )

        self._start(written, lambda sentence: self._say(f"Written: {sentence}"), form.end)

    # ------------------------------------------------------------------ what is possible

    def _show_buttons(self) -> None:
        chosen = self.list.chosen()
        one = chosen[0] if len(chosen) == 1 else None
        is_cut_short = one is not None and self._is_cut_short(one)
        self.play_button.setText("Repair" if is_cut_short else "Play")
        self.play_button.setEnabled(one is not None)
        for act in (self.analyse, self.export):
            act.setEnabled(one is not None and not is_cut_short)
        self.compare_button.setEnabled(len(chosen) >= 2)
        if one is None:
            return
        if is_cut_short:
            self._say(self._read[one][1].problem)
        for form in (self.analysis_form, self.export_form):
            if form.isVisible():
                form.show_session(one)

    def _say(self, sentence: str, *, is_alarm: bool = False) -> None:
        self.said.setText(typeset(sentence))
        tint(self.said, Tone.BAD if is_alarm else Tone.NEUTRAL)
        if is_alarm:
            self._model.said.emit(sentence, False)


def recent_menu(parent: QWidget, memory: WindowMemory, act: Take) -> QMenu:
    """A menu of the sessions that were opened or recorded last, and what is done with one."""
    menu = QMenu("&Recent sessions", parent)

    def fill() -> None:
        menu.clear()
        for path in memory.recent("session"):
            menu.addAction(str(path), partial(act, path))
        if menu.isEmpty():
            menu.addAction("No session was opened yet").setEnabled(False)

    menu.aboutToShow.connect(fill)
    return menu
