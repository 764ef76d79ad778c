"""Set up: the settings of the next run, those of every evening on top, all of them below."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from pathlib import Path

from PySide6.QtCore import Qt, QTimer
from PySide6.QtGui import QKeySequence, QShortcut
from PySide6.QtWidgets import (
    QCheckBox,
    QFileDialog,
    QLabel,
    QLineEdit,
    QMenu,
    QScrollArea,
    QToolButton,
    QWidget,
)

from app.gui.background import BackgroundWork
from app.gui.cells import Tone
from app.gui.desk import Desk
from app.gui.editors import NAME_WIDTH, FieldRow, LineEditor
from app.gui.file_question import SESSION_FILES, ask_file
from app.gui.form import DEFAULTS, STEPS_KEY, Base, Form, FormField, FormGroup
from app.gui.group_view import GroupView
from app.gui.protocol_editor import ProtocolEditor
from app.gui.session_place import Place, named, place_of
from app.gui.widgets import STRETCH, Panel, column, label, row, tint
from app.settings.config import bench_names
from app.settings.sections import Config
from app.system.errors import UserError

EVENING = {  # key -> its name, of what is another every evening
    "run.normal_force": "Load P",
    "run.travel": "Travel δ",
    "run.velocity": "Velocity",
    "dic.preset": "Correlation",
    "dic.box": "Box",
}
ABOUT = {"about.sample": "Sample", "about.operator": "Operator", "about.note": "Note"}
NOTE_LINES = 3
MOST_TYPED = 40  # characters of what was refused that a sentence repeats
TOML_FILES = "Settings files (*.toml);;All files (*)"
HELP_LINES = 4


class SetupPanel(Panel):
    """The settings of the next run.

    What is typed is checked at once, by the declaration of its setting; what can not be used stays
    beside its field with the reason, and no run begins before it is corrected.
    """

    name = "setup"
    title = "Set up"
    keys = (
        ("Ctrl+R", "The setting that is edited is again as it was in what it is compared with."),
    )

    def __init__(self, desk: Desk) -> None:
        super().__init__()
        self.desk, self.form = desk, Form(desk.config)
        self._background = BackgroundWork(self)
        self.rows: dict[str, list[FieldRow]] = {}
        self.groups: list[GroupView] = []
        self._values, self._base_values = self.form.values(), self.form.base_values()
        self._changed: set[str] = set()
        self._is_misnamed = False  # what stands in the field of the session can not be used
        self._places = BackgroundWork(self)  # a folder may take long to answer
        self._usable = desk.session
        self._looked_at: Path | str | None = ""  # the session whose place was looked at last
        self._build()
        desk.settings_changed.connect(self._follow)
        desk.busy_changed.connect(self._show_busy)
        self._follow()
        self._show_busy(desk.is_busy)

    def row(self, key: str) -> FieldRow:
        """The row of a setting that is first in view."""
        return self.rows[key][0]

    def refusal(self) -> str:
        """What stands in the form and can not be used, and why; empty where all of it can."""
        if self._is_misnamed:
            return f"Session can not be used as typed: {self.place.text()}"
        for key, refused in self.form.refused.items():
            rows = self.rows.get(key)
            name = rows[0].title if rows else "Protocol" if key == STEPS_KEY else key
            typed = f" ({refused.text})" if len(refused.text) <= MOST_TYPED else ""
            return f"{name} can not be used as typed{typed}: {refused.sentence}"
        return ""

    def go_to_refused(self) -> None:
        """Put the keys into the field that `refusal` speaks of, and bring it into view."""
        editor: QWidget = self.session
        if not self._is_misnamed:
            key = next(iter(self.form.refused))
            if key == STEPS_KEY:
                self.protocol.edit.setChecked(True)
                editor = self.protocol.text
            else:
                rows = self.rows[key]
                if not any(one.isVisible() for one in rows):
                    self._open_group_of(key)
                editor = next((one for one in rows if one.isVisible()), rows[0]).editor
        editor.setFocus()
        self.area.ensureWidgetVisible(editor)

    def _open_group_of(self, key: str) -> None:
        self.search.clear()
        self.only_changed.setChecked(False)
        for view in self.groups:
            if key in view.rows:
                view.head.setChecked(True)

    # ------------------------------------------------------------------ what the operator does

    def load(self, path: Path) -> None:
        """Take the settings of a file, or of a bench that comes with the program."""
        try:
            self.form.load(path)
        except UserError as error:
            self.desk.said.emit(f"The settings stay as they are: {error}", False)
            return
        self._use()
        self.desk.said.emit(f"The next run has the settings of {path}.", False)

    def save(self, path: Path) -> None:
        """Write the settings as a file, which `slipscope run` takes."""
        path = path if path.suffix else path.with_name(f"{path.name}.toml")
        try:
            self.form.save(path)
        except (UserError, OSError) as error:
            self.desk.said.emit(f"The settings were not saved: {error}", False)
            return
        self._refresh()
        self.desk.said.emit(f"The settings are saved in {path.absolute()}.", False)

    def compare(self, session: Path) -> None:
        """Mark what differs from the settings of a recorded run."""

        def compared(config: Config) -> None:
            self._compare_with(Base(session.name, config))
            self.only_changed.setChecked(True)

        self._background.start_anew(
            lambda: self.desk.factory.settings_of(session),
            compared,
            lambda why: self.desk.said.emit(f"The settings were not compared: {why}", False),
        )

    # ------------------------------------------------------------------ form and desk

    def _type(self, field: FormField, text: str) -> None:
        self.form.type(field, text)
        self._use()

    def _put_steps(self, text: str) -> None:
        self.form.put_steps(text)
        self._use()

    def _reset(self, field: FormField) -> None:
        self.form.reset(field.key)
        self._use()

    def _reset_focused(self) -> None:
        for one in self.findChildren(FieldRow):
            if one.editor.hasFocus():
                self._reset(one.field)
                return

    def _use(self) -> None:
        """Let the next run have what can be used of the form."""
        if self.form.config == self.desk.config:
            self._refresh()
        else:
            self.desk.set_config(self.form.config)

    def _follow(self) -> None:
        """Show the settings that the desk has."""
        if self.desk.config != self.form.config:
            self.form.replace(self.desk.config)
        self._refresh()
        if not self._is_misnamed and named(self.session.text()) != self.desk.session:
            self.session.show_text(str(self.desk.session or ""))
        if self.desk.session != self._looked_at:
            self._look_at_place()

    def _name(self, text: str) -> None:
        """Let the next run record the file of this name; if it turns out that it can not be
        written, the name before is that of the next run again.
        """
        self._is_misnamed = False
        if named(text) == self.desk.session:
            self._follow()
            self._look_at_place()
        else:
            self.desk.set_session(named(text))

    def _compare_with(self, base: Base) -> None:
        self.form.base = base
        self._refresh()

    # ------------------------------------------------------------------ drawing

    def _refresh(self) -> None:
        groups = self.form.groups()
        if [view.group for view in self.groups] != list(groups):
            self._build_groups(groups)  # another driver has other options of its own
        self._values, self._base_values = self.form.values(), self.form.base_values()
        for rows in self.rows.values():
            for one in rows:
                self._show_row(one)
        self.protocol.refresh()
        self._show_refused()
        changed = self._changed = set(self.form.changed())
        # which the list below has no row for
        steps = ", the protocol among them" if STEPS_KEY in changed else ""
        self.compared.setText(
            f"● {len(changed)} not as in {self.form.base.name}{steps}"
            if changed
            else f"all as in {self.form.base.name}"
        )
        self._filter()

    def _show_row(self, one: FieldRow) -> None:
        key = one.field.key
        value, base = self._values[key], self._base_values.get(key)
        one.show_value(value, base, self.form.base.name, self.form.refused.get(key))

    def _filter(self) -> None:
        words = self.search.text().casefold().split()
        changed = self._changed if self.only_changed.isChecked() else None
        for view in self.groups:
            view.show_only(words, changed)

    def _look_for(self) -> None:
        """Show what is looked for, and bring it into view."""
        self._filter()
        QTimer.singleShot(0, self, self._scroll_to_found)

    def _scroll_to_found(self) -> None:
        self.area.verticalScrollBar().setValue(self.search.geometry().top() - 4)

    def _show_refused(self) -> None:
        count = len(self.form.refused)
        what = "One setting" if count == 1 else f"{count} settings"
        beside, until = ("it", "it is") if count == 1 else ("them", "they are")
        self.refused.setText(
            f"{what} can not be used as typed: see the sentence beside {beside}. No run begins"
            f" before {until} corrected, or taken back by ↺."
        )
        self.refused.setVisible(count > 0)

    def _look_at_place(self) -> None:
        """Look where the next run is recorded, beside the window, and say it; unless the name that
        was typed is no good.
        """
        if not self._is_misnamed:
            session = self._looked_at = self.desk.session
            self._places.start_anew(
                lambda: place_of(session),
                self._show,
                lambda why: self._show(Place(session, why, is_usable=False)),
            )

    def _show(self, place: Place) -> None:
        self.place.setText(place.sentence)
        tint(self.place, None if place.is_usable else Tone.BAD)
        self._is_misnamed = not place.is_usable
        if place.is_usable:
            self._usable = place.session
            if not self.session.isModified():
                self.session.show_text(str(place.session or ""))
        elif self.desk.session != self._usable:
            self.desk.set_session(self._usable)

    def _show_busy(self, is_busy: bool) -> None:
        self.busy.setVisible(is_busy)
        self._look_at_place()

    def _show_help(self, field: FormField) -> None:
        self.help.setText(f"{field.key}: {field.help}")

    # ------------------------------------------------------------------ building

    def _build(self) -> None:
        self.busy = self._banner("A run is on: what is changed here is for the next one.")
        self.refused = self._banner("")
        tint(self.refused, Tone.BAD)
        self.help = label("What the setting that is edited means stands here.", "muted")
        self.help.setWordWrap(True)
        self.help.setAlignment(Qt.AlignmentFlag.AlignTop)
        self.help.setFixedHeight(HELP_LINES * self.help.fontMetrics().lineSpacing())
        self._build_session()
        self._build_files()
        self.protocol = ProtocolEditor(self.form)
        self.protocol.entered.connect(self._put_steps)
        self.all = column(spacing=0)
        page = QWidget()
        page.setObjectName("page")
        evening = [self._evening_row(key, name) for key, name in EVENING.items()]
        about = [self._evening_row(key, name) for key, name in ABOUT.items()]
        page.setLayout(
            column(
                *evening,
                self.protocol,
                8,
                *self._session_part,
                8,
                *about,
                12,
                label("All settings", "heading"),
                row((self.search, 1), self.only_changed, spacing=6),
                row((self.compared, 1), self.compare_menu, spacing=6),
                self.all,
                STRETCH,
                spacing=6,
                margins=(0, 0, 8, 0),
            )
        )
        self.area = scroll = QScrollArea()
        scroll.setWidget(page)
        scroll.setWidgetResizable(True)
        scroll.setFrameShape(QScrollArea.Shape.NoFrame)
        scroll.setHorizontalScrollBarPolicy(Qt.ScrollBarPolicy.ScrollBarAlwaysOff)
        scroll.setFocusPolicy(Qt.FocusPolicy.NoFocus)
        buttons = row(self.load_menu, self.save_button, STRETCH, spacing=6)
        parts = (buttons, self.busy, self.refused, (scroll, 1), self.help)
        self.setLayout(column(*parts, spacing=6, margins=(8, 8, 4, 6)))
        self.setMinimumWidth(320)
        reset = QShortcut(QKeySequence("Ctrl+R"), self)
        reset.setContext(Qt.ShortcutContext.WidgetWithChildrenShortcut)
        reset.activated.connect(self._reset_focused)

    def _banner(self, text: str) -> QLabel:
        made = label(text, "detail")
        made.setWordWrap(True)
        made.hide()
        return made

    def _evening_row(self, key: str, name: str) -> FieldRow:
        lines = NOTE_LINES if key == "about.note" else 0
        return self._made_row(self.form.field(key), name, lines)

    def _made_row(self, field: FormField, name: str = "", lines: int = 0) -> FieldRow:
        made = FieldRow(field, name, lines)
        made.entered.connect(self._type)
        made.reset_asked.connect(self._reset)
        made.focused.connect(self._show_help)
        self.rows.setdefault(field.key, []).append(made)
        self._show_row(made)
        return made

    def _build_groups(self, groups: tuple[FormGroup, ...]) -> None:
        """All settings by table, anew."""
        for view in self.groups:
            for key, one in view.rows.items():
                self.rows[key].remove(one)
            view.setParent(None)
            view.deleteLater()
        self.rows = {key: rows for key, rows in self.rows.items() if rows}
        self.groups = [GroupView(group, self._made_row) for group in groups]
        for view in self.groups:
            view.head.toggled.connect(self._filter)
            self.all.addWidget(view)

    def _build_session(self) -> None:
        self.session, self.place = LineEditor(), label("", "muted")
        self.session.setPlaceholderText("by date and time")
        self.session.setAccessibleName("Session file")
        self.session.setToolTip(
            "The file that the next run records; empty: named by date and time. Files that are"
            " there are never replaced."
        )
        self.session.entered.connect(self._name)
        self.place.setWordWrap(True)
        self.place.setTextInteractionFlags(Qt.TextInteractionFlag.TextSelectableByMouse)
        browse = QToolButton()
        browse.setObjectName("framed")
        browse.setText("…")
        browse.setToolTip("Choose folder and name of the session")
        browse.clicked.connect(self._browse)
        name = label("Session", "name")
        name.setFixedWidth(NAME_WIDTH)
        self._session_part = (row(name, (self.session, 1), browse, spacing=6), self.place)

    def _build_files(self) -> None:
        self.load_menu = self._menu(
            "Load",
            "Takes the settings of a file, or of a bench that comes with the program",
            {
                "A settings file …": self._browse_load,
                **{f"Bench {name}": partial(self.load, Path(name)) for name in bench_names()},
                "The defaults": self._load_defaults,
            },
        )
        self.save_button = QToolButton()
        self.save_button.setObjectName("framed")
        self.save_button.setText("Save …")
        self.save_button.setToolTip("Writes the settings as a file for `slipscope run FILE`")
        self.save_button.clicked.connect(self._browse_save)
        self.compare_menu = self._menu(
            "Compare",
            "What the settings are compared with: what differs is marked, and a reset takes it",
            {
                "With the defaults": lambda: self._compare_with(Base(DEFAULTS, Config())),
                "With a session …": self._browse_session,
            },
        )
        self.search, self.only_changed = QLineEdit(), QCheckBox("only changed")
        self.search.setPlaceholderText("Search the settings")
        self.search.setClearButtonEnabled(True)
        self.search.setMinimumWidth(60)
        self.compared = label("", "muted")
        self.compared.setWordWrap(True)
        self.search.textChanged.connect(self._look_for)
        self.only_changed.toggled.connect(self._look_for)

    def _menu(self, text: str, tip: str, acts: dict[str, Callable[[], object]]) -> QToolButton:
        button, menu = QToolButton(), QMenu(self)
        for name, act in acts.items():
            menu.addAction(name).triggered.connect(lambda _=False, act=act: act())
        button.setObjectName("framed")
        button.setText(text)
        button.setToolTip(tip)
        button.setMenu(menu)
        button.setPopupMode(QToolButton.ToolButtonPopupMode.InstantPopup)
        return button

    # ------------------------------------------------------------------ files

    def _load_defaults(self) -> None:
        self.form.replace(Config())
        self.form.base = Base(DEFAULTS, Config())
        self._use()

    def _browse(self) -> None:
        ask_file(
            self,
            "Session that the next run records",
            lambda path: self._name(str(path)),
            start=self.desk.session or Path.cwd(),
            kinds=SESSION_FILES,
            mode=QFileDialog.FileMode.AnyFile,
            may_exist=True,
        )

    def _browse_load(self) -> None:
        ask_file(self, "Load settings", self.load, kinds=TOML_FILES)

    def _browse_save(self) -> None:
        ask_file(
            self,
            "Save settings",
            self.save,
            start=Path("slipscope.toml"),
            kinds=TOML_FILES,
            mode=QFileDialog.FileMode.AnyFile,
        )

    def _browse_session(self) -> None:
        ask_file(self, "Compare with a session", self.compare, kinds=SESSION_FILES)
