"""The campaign: its runs with what has become of them, and the next one for the bench."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

from PySide6.QtCore import Qt
from PySide6.QtGui import QBrush, QColor
from PySide6.QtWidgets import (
    QHeaderView,
    QMenu,
    QPushButton,
    QToolButton,
    QTreeWidget,
    QTreeWidgetItem,
)

from app.campaigns.plan import campaign_names
from app.gui import campaign_lines, theme
from app.gui.background import BackgroundWork
from app.gui.campaign_lines import TONES, CampaignLines, CampaignRun
from app.gui.cells import typeset
from app.gui.desk import Desk
from app.gui.file_question import ask_file
from app.gui.widgets import STRETCH, EmptyNote, Panel, by_pointer_only, column, label, row
from app.system.durations import duration

CAMPAIGN_FILES = "Campaigns (*.toml);;All files (*)"
NUMBER, RUN, STATE, TIME = range(4)


class CampaignPanel(Panel):
    """The runs of a campaign file; one is put on the desk, so that Start runs it."""

    name = "campaign"
    title = "Campaign"
    keys = (("Enter", "Takes the run that is chosen in the list: Start runs it."),)

    def __init__(self, desk: Desk) -> None:
        super().__init__()
        self.desk, self._background = desk, BackgroundWork(self)
        self.lines: CampaignLines | None = None
        self._items: list[QTreeWidgetItem] = []  # of the runs, in their order
        self._begun: Path | None = None  # the session of the run that is under way
        self._build()
        desk.settings_changed.connect(self._show_set)
        desk.busy_changed.connect(self._follow_run)
        desk.ended.connect(lambda _: self.renew())
        self._show()

    # ------------------------------------------------------------------ what the operator does

    def open(self, file: Path) -> None:
        """Show the runs of a campaign."""
        self._do(lambda: campaign_lines.look(file), self._take_lines)

    def renew(self) -> None:
        """Look again what has become of the runs, and renew the campaign's page."""
        if self.lines is not None:
            file = self.lines.file
            self._do(lambda: campaign_lines.renew(file), self._take_lines)

    def take(self, run: CampaignRun) -> None:
        """Put a run on the desk; what there was of it is kept aside."""
        if self.lines is None:
            return
        file, number = self.lines.file, run.number

        def put(lines: CampaignLines) -> None:
            self._take_lines(lines)
            taken = lines.runs[number - 1]
            about = taken.config.about
            if not about.operator:
                about = replace(about, operator=self.desk.config.about.operator)
            self.desk.lend(replace(taken.config, about=about), taken.session)
            self.desk.said.emit(f"Start (F5) begins {typeset(taken.orders)}.", False)

        self._do(lambda: campaign_lines.claim(file, number), put)

    # ------------------------------------------------------------------ drawing

    def _do(
        self, work: Callable[[], CampaignLines], done: Callable[[CampaignLines], object]
    ) -> None:
        self._background.start_anew(
            work, done, lambda why: self.desk.said.emit(f"Campaign: {why}", False)
        )

    def _take_lines(self, lines: CampaignLines) -> None:
        self.lines = lines
        self._show()

    def _show(self) -> None:
        lines = self.lines
        self.heading.setText(lines.name if lines else "No campaign is open.")
        self.folder.setText(f"Sessions in {lines.folder.absolute()}" if lines else "")
        self.sentence.setText(lines.sentence if lines else "")
        chosen = self._chosen()
        self.list.clear()
        self._items = []
        for run in lines.runs if lines else ():
            texts = (str(run.number), run.name, run.state, duration(run.seconds))
            item = QTreeWidgetItem(list(texts))
            item.setForeground(STATE, QBrush(QColor(theme.TONES[TONES[run.state]])))
            item.setToolTip(
                RUN, "\n".join(filter(None, (typeset(run.orders), typeset(run.reason))))
            )
            item.setToolTip(STATE, run.reason)
            item.setTextAlignment(TIME, Qt.AlignmentFlag.AlignRight)
            self.list.addTopLevelItem(item)
            self._items.append(item)
        if 0 <= chosen < len(self._items):
            self.list.setCurrentItem(self._items[chosen])
        self._show_set()
        self._show_chosen()

    def _show_set(self) -> None:
        """Mark the run that Start would begin, and say what the button does."""
        lines = self.lines
        on_desk = self._on_desk()
        for item, run in zip(self._items, lines.runs if lines else (), strict=True):
            font = item.font(RUN)
            font.setBold(run is on_desk)
            item.setFont(RUN, font)
            item.setText(NUMBER, f"▶ {run.number}" if run is on_desk else str(run.number))
        due = lines.next if lines else None
        is_set = due is not None and due is on_desk
        is_busy = self.desk.is_busy
        self.next.setEnabled(due is not None and not (is_set and is_busy))
        if due is None:
            self.next.setText("All is done" if lines else "Next run")
        elif is_set:
            what = f"run {due.number}, {due.name}"
            self.next.setText(f"{what} is under way" if is_busy else f"Start {what}  F5")
        else:
            self.next.setText(f"Next: run {due.number}, {due.name}")

    def _follow_run(self, is_busy: bool) -> None:
        on_desk = self._on_desk()
        self._begun = on_desk.session if is_busy and on_desk else None
        self._show_set()

    def _on_desk(self) -> CampaignRun | None:
        """The run whose settings and file the next run has, or the one under way has, until it is
        done; sample, operator and note are the operator's to say.
        """
        config, session = self.desk.config, self.desk.session
        for run in self.lines.runs if self.lines else ():
            is_same = run.session == session and replace(run.config, about=config.about) == config
            if run.is_due and (is_same or run.session == self._begun):
                return run
        return None

    def _chosen(self) -> int:
        """Place of the run that is chosen in the list, from 0; -1 if none is."""
        item = self.list.currentItem()
        return -1 if item is None else self.list.indexOfTopLevelItem(item)

    def _show_chosen(self) -> None:
        at = self._chosen()
        run = self.lines.runs[at] if self.lines and at >= 0 else None
        parts = (typeset(run.orders), typeset(run.reason)) if run else ()
        self.about.setText("\n".join(filter(None, parts)))
        self.about.setVisible(run is not None)

    def _go_on(self) -> None:
        """Put the next run on the desk; start it where it is there."""
        due = self.lines.next if self.lines else None
        if due is not None and due is self._on_desk():
            self.desk.begin_asked.emit()
        elif due is not None:
            self.take(due)

    def _take_chosen(self, item: QTreeWidgetItem) -> None:
        if self.lines is not None:
            self.take(self.lines.runs[self.list.indexOfTopLevelItem(item)])

    def _browse(self) -> None:
        ask_file(self, "Open a campaign", self.open, kinds=CAMPAIGN_FILES)

    def _fill_menu(self) -> None:
        self.menu.clear()
        self.menu.addAction("A campaign file …").triggered.connect(self._browse)
        for name in campaign_names():
            act = self.menu.addAction(f"Campaign {name}")
            act.triggered.connect(lambda _=False, name=name: self.open(Path(name)))

    # ------------------------------------------------------------------ building

    def _build(self) -> None:
        self.heading, self.folder = label("", "heading"), label("", "muted")
        self.sentence, self.about = label("", "muted"), label("", "muted")
        for words in (self.folder, self.sentence, self.about):
            words.setWordWrap(True)
        self.open_button, self.menu = QToolButton(), QMenu(self)
        self.open_button.setObjectName("framed")
        self.open_button.setText("Open")
        self.open_button.setToolTip("Opens a campaign: a file of runs over loads, samples, repeats")
        self.open_button.setMenu(self.menu)
        self.open_button.setPopupMode(QToolButton.ToolButtonPopupMode.InstantPopup)
        self.menu.aboutToShow.connect(self._fill_menu)
        self.next = QPushButton("Next run")
        by_pointer_only(self.next)
        self.next.setToolTip("Puts settings and file of the next run on the desk, then starts it")
        self.next.clicked.connect(self._go_on)
        self.list = QTreeWidget()
        self.list.setRootIsDecorated(False)
        self.list.setHeaderLabels(["", "run", "state", "time"])
        self.list.setMinimumHeight(120)
        self.list.setToolTip("Enter or a double click puts a run on the desk, also one that failed")
        self.list.setAccessibleName("Runs of the campaign")
        EmptyNote(
            self.list,
            "The runs of a campaign, over loads, velocities, samples and repeats, with what has"
            " become of each. Open takes a campaign file, or one that comes with the program.",
        )
        head = self.list.header()
        head.setStretchLastSection(False)
        head.setSectionResizeMode(RUN, QHeaderView.ResizeMode.Stretch)
        for part in (NUMBER, STATE, TIME):
            head.setSectionResizeMode(part, QHeaderView.ResizeMode.ResizeToContents)
        self.list.itemActivated.connect(self._take_chosen)
        self.list.currentItemChanged.connect(lambda *_: self._show_chosen())
        top = row(self.heading, STRETCH, self.open_button, spacing=6)
        parts = (self.sentence, self.folder, self.next, (self.list, 1), self.about)
        self.setLayout(column(top, *parts, spacing=6, margins=(10, 8, 10, 8)))
