"""Set up: the settings of the next run, those that change often on top, all of them below."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from pathlib import Path

from PySide6.QtCore import QLocale, Qt
from PySide6.QtWidgets import QCheckBox, QFileDialog, QLineEdit, QWidget

from app.gui.background import Act, BackgroundWork
from app.gui.cells import Tone
from app.gui.file_question import SESSION_FILES, ask_file
from app.gui.form import (
    DEFAULTS,
    OWN_STEPS,
    STEPS_KEY,
    Base,
    Form,
    FormField,
    Steps,
    protocols,
    read_base,
    text_field,
    write_base,
)
from app.gui.protocol_editor import ProtocolEditor
from app.gui.session_place import Place, named, place_of
from app.gui.setting_row import RowState, SettingRow
from app.gui.settings_list import SettingsList
from app.gui.widgets import (
    STRETCH,
    Panel,
    label,
    menu_button,
    row,
    shortcut,
    tint,
    tool_button,
    widget,
)
from app.gui.window_model import WindowModel
from app.settings.config import bench_names

FREQUENT = {  # key -> its name, of what is another in many runs
    "run.normal_force": "Load P",
    "run.travel": "Travel δ",
    "run.velocity": "Velocity",
    "dic.preset": "Correlation",
    "dic.box": "Box",
}
ABOUT = {"about.sample": "Sample", "about.operator": "Operator", "about.note": "Note"}
NOTE_LINES = 3
SESSION_KEY = "session"
MOST_TYPED = 40  # characters of what was refused that a sentence repeats
TOML_FILES = "Settings files (*.toml);;All files (*)"
HELP_LINES = 3


class SetupPanel(Panel):
    """The settings of the next run.

    What is typed is checked at once, by the declaration of its setting; what cannot be used stays
    in its field with the reason, and no run begins before it is corrected.
    """

    name = "setup"
    title = "Set up"
    keys = (
        ("Ctrl+R", "The setting that is edited is again as it was in what it is compared with."),
    )

    def __init__(self, model: WindowModel) -> None:
        super().__init__()
        self.model, self.form = model, Form(model.config, QLocale().decimalPoint())
        self._background = BackgroundWork(self)
        self._values, self._base_values = self.form.values(), self.form.base_values()
        self._of_steps: set[str] = set()  # keys that the steps of the protocol say themselves
        self._changed: set[str] = set()
        self._misnamed = ""  # what stands in the field of the session, if it cannot be used
        self._typed_name = ""
        self._places = BackgroundWork(self)  # a folder may take long to answer
        self._place = Place(model.session, "")
        self._usable = model.session
        self._looked_at: Path | str | None = ""  # the session whose place was looked at last
        self._build()
        model.settings_changed.connect(self._follow)
        model.busy_changed.connect(self._show_busy)
        self.restored.setVisible(bool(model.restored))
        self._follow()
        self._show_busy(model.is_busy)

    def row(self, key: str) -> SettingRow:
        """The row of a setting that is first in view."""
        return self.settings.rows(key)[0]

    def refusal(self) -> str:
        """What stands in the form and cannot be used, and why; empty where all of it can."""
        if self._misnamed:
            return f"Session cannot be used as typed: {self._place.sentence}"
        for key, refused in self.form.refused.items():
            rows = self.settings.rows(key)
            name = rows[0].title if rows else key
            is_short = len(refused.text) <= MOST_TYPED and key != STEPS_KEY
            typed = f" ({refused.text})" if is_short else ""
            return f"{name} cannot be used as typed{typed}: {refused.sentence}"
        return ""

    def go_to_refused(self) -> None:
        """Put the keys into the field that `refusal` speaks of, and bring it into view."""
        self.search.clear()
        self.only_changed.setChecked(False)
        key = SESSION_KEY if self._misnamed else next(iter(self.form.refused))
        if key == STEPS_KEY:
            self.protocol.go_to_refused()
            return
        if not self.settings.rows(key):
            self.settings.table(key.partition(".")[0]).open()
        self.settings.go_to(self.row(key))

    # ------------------------------------------------------------------ what the operator does

    def load(self, path: Path) -> None:
        """Take the settings of a file, or of a bench that comes with the program."""

        def loaded(base: Base) -> None:
            self.take(base)
            self.model.said.emit(f"The next run has the settings of {path}.", False)

        self._do(partial(read_base, path), loaded, "The settings stay as they are")

    def save(self, path: Path) -> None:
        """Write the settings as a file, which `slipscope run` takes."""

        def saved(base: Base) -> None:
            self._compare_with(base)
            self.model.said.emit(f"The settings are saved in {path.absolute()}.", False)

        self._do(partial(write_base, path, self.form.config), saved, "The settings were not saved")

    def take(self, base: Base) -> None:
        """Take these settings, and compare with them."""
        self.restored.hide()
        self.form.replace(base.config)
        self.form.base = base
        self._use()

    def _do(self, work: Callable[[], Base], done: Callable[[Base], object], failed: str) -> None:
        """Read or write a file, in the background; say `failed` and why where that fails."""
        self._background.start_anew(
            work, done, lambda why: self.model.said.emit(f"{failed}: {why}", False)
        )

    def compare(self, session: Path) -> None:
        """Mark what differs from the settings of a recorded run."""

        def compared(base: Base) -> None:
            self._compare_with(base)
            self.only_changed.setChecked(True)

        self._do(
            lambda: Base(session.name, self.model.factory.settings_of(session)),
            compared,
            "The settings were not compared",
        )

    # ------------------------------------------------------------------ form and model

    def _type(self, field: FormField, text: str) -> None:
        """Let the next run have what was typed into a row."""
        if field.key == SESSION_KEY:
            self._name(text)
        elif field.key == STEPS_KEY:
            self._choose(text)
        elif field.key.startswith(f"{STEPS_KEY}."):
            self.protocol.change(field, text)
        else:
            self.form.type(field, text)
            self._use()

    def _choose(self, protocol: str) -> None:
        if protocol == OWN_STEPS:
            self._refresh()
        else:
            self._put_steps(protocols()[protocol])

    def _put_steps(self, steps: Steps) -> None:
        self.form.put_steps(steps)
        self._use()

    def _reset(self, field: FormField) -> None:
        if field.key == SESSION_KEY or field.key.startswith(f"{STEPS_KEY}."):
            self._type(field, "")
        else:
            self.form.reset(field.key)
            self._use()

    def _reset_focused(self) -> None:
        for one in self.settings.rows():
            if one.editor.hasFocus():
                self._reset(one.field)
                return

    def _use(self) -> None:
        """Let the next run have what can be used of the form."""
        if self.form.config == self.model.config:
            self._refresh()
        else:
            self.model.set_config(self.form.config)

    def _follow(self) -> None:
        """Show the settings of the next run."""
        if self.model.config != self.form.config:
            self.form.replace(self.model.config)
        self._refresh()
        self.lent.setVisible(self.model.is_lent)
        if self.model.session != self._looked_at:
            self._look_at_place()

    def _name(self, text: str) -> None:
        """Let the next run record the file of this name; if it turns out that it cannot be
        written, the name before is that of the next run again.
        """
        self._misnamed, self._typed_name = "", text
        if named(text) == self.model.session:
            self._follow()
            self._look_at_place()
        else:
            self.model.set_session(named(text))

    def _compare_with(self, base: Base) -> None:
        self.form.base = base
        self._refresh()

    # ------------------------------------------------------------------ drawing

    def _refresh(self) -> None:
        form = self.form
        self.settings.put_groups(form.groups())
        self._values, self._base_values = form.values(), form.base_values()
        self._of_steps = form.config.run.said_by_steps
        self.protocol.refresh()
        self.settings.refresh()
        self._show_refused()
        changed = self._changed = set(form.changed())
        # which the list below has no row for
        steps = ", the protocol among them" if STEPS_KEY in changed else ""
        self.compared.setText(
            f"● {len(changed)} not as in {form.base.name}{steps}"
            if changed
            else f"all as in {form.base.name}"
        )
        self._filter()

    def _state(self, field: FormField) -> RowState:
        """What the row of a field shows."""
        key, form = field.key, self.form
        refused = form.refused.get(key)
        refusal = refused.sentence if refused else ""
        if key == SESSION_KEY:
            words, default = self._place.sentence, "by date and time"
            if self._misnamed:
                return RowState(self._misnamed, refusal=words, placeholder=default)
            return RowState(str(self.model.session or ""), note=words, placeholder=default)
        if key.startswith(f"{STEPS_KEY}."):
            return self.protocol.state(field)
        if key == STEPS_KEY:
            is_own = self._values[key] != self._base_values[key]
            shown = "" if self.protocol.has_row_for_refusal else refusal
            return RowState(form.protocol(), f"{form.base.name}: another", is_own, shown)
        value, base = self._values[key], self._base_values.get(key)
        other = f"{field.text(base)} {field.unit}".strip() if base is not None else "none"
        is_said = key in self._of_steps and not refused
        return RowState(
            refused.text if refused else field.text(value),
            f"{form.base.name}: {other}",
            value != base,
            refusal,
            "Each step of the protocol says its own." if is_said else "",
            is_enabled=not is_said,
        )

    def _filter(self) -> None:
        words = self.search.text().casefold().split()
        self.settings.show_only(words, self._changed if self.only_changed.isChecked() else None)

    def _show_refused(self) -> None:
        count = len(self.form.refused)
        what = "One setting" if count == 1 else f"{count} settings"
        beside, until = ("it", "it is") if count == 1 else ("them", "they are")
        self.refused.setText(
            f"{what} cannot be used as typed: see the sentence beside {beside}. No run begins"
            f" before {until} corrected, or taken back by ↺."
        )
        self.refused.setVisible(count > 0)

    def _look_at_place(self) -> None:
        """Look where the next run is recorded, beside the window, and say it; unless the name that
        was typed is no good.
        """
        if not self._misnamed:
            session = self._looked_at = self.model.session
            self._places.start_anew(
                lambda: place_of(session),
                self._show,
                lambda why: self._show(Place(session, why, is_usable=False)),
            )

    def _show(self, place: Place) -> None:
        self._place = place
        self._misnamed = "" if place.is_usable else self._typed_name or str(place.session)
        if place.is_usable:
            self._usable = place.session
        elif self.model.session != self._usable:
            self.model.set_session(self._usable)
        self.settings.refresh()

    def _show_busy(self, is_busy: bool) -> None:
        self.busy.setVisible(is_busy)
        self._look_at_place()

    def _show_help(self, field: FormField) -> None:
        self.help.setText(f"{field.key}: {field.help}")

    # ------------------------------------------------------------------ building

    def _build(self) -> None:
        text = "A run is on: what is changed here is for the next one."
        self.busy = label(text, "detail", wraps=True, visible=False)
        self.restored = _offer(
            f"As at the end of the last evening ({self.model.restored}).",
            "The defaults",
            partial(self.take, DEFAULTS),
        )
        self.lent = _offer(
            "The settings of a run of the campaign, for that run alone: yours are back when it"
            " begins.",
            "Back now",
            self.model.give_back,
        )
        self.refused = label("", "detail", wraps=True, visible=False)
        tint(self.refused, Tone.BAD)
        self.help = label("What the setting that is edited means stands here.", "muted", wraps=True)
        self.help.setAlignment(Qt.AlignmentFlag.AlignTop)
        self.help.setFixedHeight(HELP_LINES * self.help.fontMetrics().lineSpacing())
        self._build_files()
        self.settings = SettingsList(self._state)
        self.settings.setAccessibleName("Settings of the next run")
        parts = (
            row(self.load_menu, self.save_button, STRETCH, self.compare_menu),
            *(self.restored, self.lent, self.busy, self.refused),
            row((self.search, 1), self.only_changed),
            *(self.compared, (self.settings, 1), self.help),
        )
        self.hold(*parts)
        self._build_rows()
        self.settings.entered.connect(self._type)
        self.settings.reset_asked.connect(self._reset)
        self.settings.focused.connect(self._show_help)
        self.setMinimumWidth(320)
        shortcut("Ctrl+R", self, self._reset_focused)

    def _build_rows(self) -> None:
        """The rows on top: what changes often, the protocol, the session, what it is about."""
        for key, name in FREQUENT.items():
            self.settings.add_row(self.form.field(key), name)
        meaning = "What the run does, step by step; the steps are below, and can be changed there"
        choice = text_field(STEPS_KEY, meaning, (*protocols(), OWN_STEPS))
        self.protocol = ProtocolEditor(self.form, self.settings)
        self.protocol.entered.connect(self._put_steps)
        self.settings.add_row(choice, "Protocol")
        self.settings.add(self.protocol)
        browse = tool_button("…", "Choose folder and name of the session", self._browse)
        meaning = (
            "The file that the next run records; empty: named by date and time. Files that are"
            " there are never replaced"
        )
        place = self.settings.add_row(text_field(SESSION_KEY, meaning), "Session", beside=(browse,))
        self.session, self.place = place.editor, place.sentence
        for key, name in ABOUT.items():
            lines = NOTE_LINES if key == "about.note" else 1
            self.settings.add_row(self.form.field(key), name, lines=lines)
        self.settings.add(label("All settings", "heading"))

    def _build_files(self) -> None:
        steps = protocols()
        benches = {name: partial(self.load, Path(name)) for name in bench_names()}
        loads: dict[str, Act] = {
            "A settings file …": partial(
                ask_file, self, "Load settings", self.load, kinds=TOML_FILES
            ),
            "The defaults": partial(self.take, DEFAULTS),
        }
        self.load_menu = menu_button(
            "Load",
            "Takes the settings of a file, or of a bench that comes with the program",
            loads | {f"Bench {name}": act for name, act in benches.items() if name not in steps},
        )
        menu = self.load_menu.menu()
        menu.addSection("With a protocol of its own")
        for name in (name for name in benches if name in steps):
            menu.addAction(f"Simulated bench, {name}", benches[name])
        self.save_button = tool_button(
            "Save …",
            "Writes the settings as a file for `slipscope run FILE`",
            partial(
                ask_file,
                self,
                "Save settings",
                self.save,
                start=Path("slipscope.toml"),
                kinds=TOML_FILES,
                mode=QFileDialog.FileMode.AnyFile,
                endings=("toml",),
            ),
        )
        self.compare_menu = menu_button(
            "Compare",
            "What the settings are compared with: what differs is marked, and a reset takes it",
            {
                "With the defaults": partial(self._compare_with, DEFAULTS),
                "With a session …": partial(
                    ask_file, self, "Compare with a session", self.compare, kinds=SESSION_FILES
                ),
            },
        )
        self.search = widget(
            QLineEdit,
            placeholderText="Search all settings",
            clearButtonEnabled=True,
            minimumWidth=60,
            textChanged=self._filter,
        )
        self.only_changed = widget(QCheckBox, "only changed", toggled=self._filter)
        self.compared = label("", "muted", wraps=True)

    def _browse(self) -> None:
        ask_file(
            self,
            "Session that the next run records",
            lambda path: self._name(str(path)),
            start=self.model.session or Path.cwd(),
            kinds=SESSION_FILES,
            mode=QFileDialog.FileMode.AnyFile,
            may_exist=True,
        )


def _offer(text: str, act: str, do: Act) -> QWidget:
    """A sentence with a button, hidden."""
    made = widget(QWidget, visible=False)
    words = label(text, "detail", wraps=True)
    made.setLayout(row((words, 1), tool_button(act, act=do)))
    return made
