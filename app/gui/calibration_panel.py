"""The calibrations of the bench: what is calibrated, how old it is, and the next one."""

from __future__ import annotations

import math
from collections.abc import Collection, Sequence
from dataclasses import dataclass
from datetime import datetime
from functools import partial
from pathlib import Path
from typing import Any

from PySide6.QtCore import Qt
from PySide6.QtGui import QPixmap
from PySide6.QtWidgets import (
    QFileDialog,
    QLabel,
    QLineEdit,
    QSizePolicy,
)

from analysis.options import Section, options
from app.calibrations.calibration import Calibration
from app.calibrations.kinds import KINDS
from app.gui.background import BackgroundWork
from app.gui.cells import Tone, typeset
from app.gui.file_question import ask_file
from app.gui.form import Values, fields_of
from app.gui.setting_row import RowState, SettingRow
from app.gui.source import session_of
from app.gui.widgets import (
    Panel,
    RowList,
    button,
    by_pointer_only,
    column,
    label,
    remove,
    row,
)
from app.gui.window_model import WindowModel
from app.records.quantities import Measurement
from app.runs.run_source import RunSource
from app.session.files import next_free
from app.settings.certificates import (
    ENDING,
    CalibrationCertificate,
    certificates_of,
    picture_in,
    read_certificate,
)
from app.settings.config import from_data, tables, values_of
from app.settings.plain_values import section_from
from app.settings.sections import Config
from app.system.errors import UserError

NAME, CERTIFICATE, AGE, DUE = range(4)
NONE = ("none", "", "")
Plan = list[tuple[Config, Path]]  # runs and the sessions that they record
Asked = tuple[Calibration[Any], Section]  # a calibration with its options
LEAST_PX, BAR_PX = 240, 16  # width of the picture, and that of a bar to scroll by


@dataclass(frozen=True, slots=True)
class ShownCertificate:
    """A certificate that the panel shows, and the picture in it as the bytes of a PNG."""

    path: Path
    certificate: CalibrationCertificate
    picture: bytes


def shown_certificate(path: Path) -> ShownCertificate:
    """The certificate of a file; ConfigError where it is none."""
    return ShownCertificate(path, read_certificate(path), picture_in(path))


def words(certificate: CalibrationCertificate) -> str:
    """What a certificate says, one line for each value, setting and remark."""
    values = []
    for one in certificate.values:
        sd = math.nan if one.sd is None else one.sd
        found = Measurement(one.name, one.symbol, one.value, sd, one.unit, is_signed=True)
        values.append(" ".join(filter(None, (one.name, one.symbol))) + f": {found}")
    settings = []
    for key, value in certificate.settings.items():
        table, _, name = key.partition(".")
        settings.append(f"{key} = {value} {options(tables()[table])[name].unit}".rstrip())
    return typeset("\n".join([*values, *settings, *certificate.remarks]))


class CalibrationPanel(Panel):
    """All calibrations with the certificates of the bench; Measure makes their runs, one after the
    other, and evaluates them.
    """

    name = "calibration"
    title = "Calibration"

    def __init__(self, model: WindowModel) -> None:
        super().__init__()
        self.model, self._background = model, BackgroundWork(self)
        self._measuring, self._using, self._looking = (BackgroundWork(self) for _ in range(3))
        self.held: dict[Path, CalibrationCertificate] = {}
        self.found: ShownCertificate | None = None
        self._rows: list[SettingRow] = []  # of the options of the chosen one
        self._entered: set[str] = set()  # the names of those that were chosen, or typed
        self._fields = column(spacing=3)
        self._plan: Plan = []  # runs that are still to be made
        self._measured: list[Path] = []  # the sessions of those that are done
        self._what: Asked | None = None  # that is being measured
        self._build()
        model.settings_changed.connect(self._look)
        model.stop_pressed.connect(self._call_off)
        model.not_begun.connect(self._call_off)
        model.busy_changed.connect(self._show_measure)
        model.ended.connect(self._go_on)
        self._show_measure()
        self._show({})
        self._look()

    # ------------------------------------------------------------------ what the operator does

    def measure(self) -> None:
        """Make the runs of the chosen calibration on the bench of Set up, the first at once."""
        what = None if self._plan or self.model.is_busy else self._asked()
        if what is None:
            return
        (chosen, asked), config, folder = what, self.model.config, self._folder

        def planned() -> Plan:
            plan = chosen.plan(config, asked)
            name = f"calibration-{chosen.name}-{datetime.now():%Y%m%d-%H%M%S}"
            files = (next_free(folder / f"{name}-{n}.h5") for n in range(1, len(plan) + 1))
            return [*zip(plan, files, strict=True)]

        def begin(plan: Plan) -> None:
            if not self.model.is_busy:
                self._what, self._measured, self._plan[:] = what, [], plan
                self._begin_next()

        self._measuring.start_anew(planned, begin, self._say)

    @property
    def _folder(self) -> Path:
        """Where sessions and certificates are put: beside those of the runs."""
        return self.model.session.parent if self.model.session else Path()

    def take_files(self, files: Sequence[Path]) -> None:
        """Evaluate sessions or other files for the chosen calibration."""
        if (what := self._asked()) is not None:
            self._evaluate(*what, list(files), self._given())

    def _ask_files(self) -> None:
        """Ask for what the chosen calibration is evaluated from, several files where it takes
        several; another one has other files.
        """
        chosen, modes = self._chosen(), QFileDialog.FileMode
        if chosen is None:
            return
        mode = modes.ExistingFiles if chosen.takes_several else modes.ExistingFile
        title = f"{chosen.name}: {chosen.files}"
        dialog = ask_file(self, title, lambda _: None, start=self._folder, mode=mode)
        dialog.filesSelected.connect(lambda names: self.take_files([*map(Path, names)]))
        self.list.currentItemChanged.connect(dialog.close)

    def use(self) -> None:
        """Let the bench have what the certificate says that is shown, in place of an earlier one
        of the same calibration.
        """
        if self.found is None:
            return
        found, before = self.found, self.model.config
        what, names = found.certificate.what, before.calibration.certificates

        def used() -> Config:
            others = [name for name in names if read_certificate(Path(name)).what != what]
            data = values_of(before)
            data["calibration"]["certificates"] = [*others, str(found.path.absolute())]
            for key in found.certificate.settings:
                table, _, name = key.partition(".")
                data.get(table, {}).pop(name, None)  # gives way to the certificate
            return from_data(data, "calibration")

        def taken(config: Config) -> None:
            if self.model.config == before:
                self.model.set_config(config)
            else:
                self._say("the set-up was changed meanwhile; press Use again")

        self._using.start_anew(used, taken, self._say)

    def _asked(self) -> Asked | None:
        """The chosen calibration with its options; None where there is none, or one of these
        cannot be used, which is said.
        """
        chosen = self._chosen()
        try:
            return None if chosen is None else (chosen, self.options_of(chosen))
        except UserError as error:
            self._say(str(error))
            return None

    def options_of(self, calibration: Calibration[Any]) -> Section:
        """The options as they stand in the fields; ConfigError where one cannot be used."""
        return section_from(calibration.Options, self._given(), f"{calibration.name}: {{}}".format)

    def _given(self) -> Values:
        """What was typed or chosen, by the name of its option, be it the default."""
        rows = {one.field.option.name: one for one in self._rows}
        return {
            name: one.field.plain(one.text())
            for name, one in rows.items()
            if one.text().strip() and (name in self._entered or isinstance(one.editor, QLineEdit))
        }

    # ------------------------------------------------------------------ run by run

    def _begin_next(self) -> None:
        self._show_measure()
        if not self._plan:  # STOP was pressed meanwhile
            return
        config, session = self._plan[0]
        self.model.lend(config, session)
        self.model.begin_asked.emit()

    def _call_off(self) -> None:
        """Make no further run; Start has the operator's own settings again."""
        self._measuring.drop()
        if self._plan:
            self._plan.clear()
            self.model.give_back()
        self._show_measure()

    def _show_measure(self) -> None:
        is_free = not self.model.is_busy and not self._plan
        self.measure_button.setEnabled(is_free and self._chosen() is not None)
        self.files_button.setEnabled(self._chosen() is not None)

    def _go_on(self, source: RunSource) -> None:
        """Make the next run of the calibration, or evaluate all; a run that was not completed ends
        it.
        """
        if self._what is None or not self._plan:
            return
        config, session = self._plan[0]
        outcome = source.look().outcome
        if source.config != config or outcome is None:
            return
        if outcome.ended_as != "done":
            self._call_off()
            self._say(f"nothing is evaluated, the run {outcome.ended_as}: {outcome.reason}")
            return
        self._measured.append(session_of(source) or session)
        del self._plan[0]
        if self._plan:
            self._background.tell(self._begin_next)
        else:
            self._show_measure()
            self._evaluate(*self._what, self._measured)

    def _evaluate(
        self,
        calibration: Calibration[Any],
        options_: Section,
        files: list[Path],
        given: Collection[str] = (),
    ) -> None:
        folder = self._folder

        def evaluated() -> ShownCertificate:
            from app.calibrations.certifying import evaluated as evaluate

            name = f"{calibration.name}-{datetime.now():%Y%m%d-%H%M%S}{ENDING}"
            place = next_free(folder / name)
            evaluate(calibration, files, options_, given).write(place, overwrite=False)
            return shown_certificate(place)

        self.state.setText("The data are being evaluated …")
        self._background.start(evaluated, self._show_evaluated, self._say)

    # ------------------------------------------------------------------ drawing

    def _say(self, why: str) -> None:
        self.state.setText("")
        self.model.said.emit(f"Calibration: {why}", False)

    def _look(self) -> None:
        """Read the certificates of the bench again."""
        config = self.model.config
        if not config.calibration.certificates:
            self._show({})
            return
        self._looking.start_anew(partial(certificates_of, config), self._show, self._say)

    def _show(self, held: dict[Path, CalibrationCertificate]) -> None:
        self.held = held
        for at, (name, one) in enumerate(KINDS.items()):
            of = next(((path, found) for path, found in held.items() if found.what == name), None)
            texts = (of[0].name, of[1].age("d"), of[1].due) if of else NONE
            is_due = of is not None and of[1].is_due
            tone = Tone.BAD if is_due else Tone.GOOD if of else Tone.NEUTRAL
            self.list.put_row(at, (name, *texts), {NAME: typeset(one.title)}, {DUE: tone})

    def _show_evaluated(self, found: ShownCertificate) -> None:
        """Show it beside its own name, whatever was chosen meanwhile."""
        self._background.drop()  # the certificate of another that is on its way
        self.found = found
        at = list(KINDS).index(found.certificate.what)
        self.list.setCurrentIndex(self.list.model().index(at, NAME))
        self._show_found(found)

    def _show_found(self, found: ShownCertificate | None) -> None:
        self.found = found
        if found is None:
            self.picture.setPixmap(QPixmap())
            for part in (self.state, self.values):
                part.setText("")
            self.use_button.setEnabled(False)
            return
        self.state.setText(f"{found.path.name}, valid until {found.certificate.due}")
        self.values.setText(words(found.certificate))
        picture = QPixmap()
        picture.loadFromData(found.picture)
        width = min(picture.width(), max(LEAST_PX, self.list.width() - BAR_PX))
        self.picture.setPixmap(
            picture.scaledToWidth(width, Qt.TransformationMode.SmoothTransformation)
        )
        self.use_button.setEnabled(bool(found.certificate.settings))

    def _chosen(self) -> Calibration[Any] | None:
        at = self.list.currentIndex().row()
        return list(KINDS.values())[at] if at >= 0 else None

    def _show_chosen(self) -> None:
        """Say what the chosen calibration finds, with fields for its options."""
        chosen = self._chosen()
        if chosen is None:
            return
        self._show_measure()
        self.about.setText(typeset(f"{chosen.title} Files: {chosen.files}"))
        for one in self._rows:
            remove(one)
        self._entered.clear()
        fields = fields_of(chosen.name, chosen.Options, self.locale().decimalPoint())
        self._rows = [SettingRow(one) for one in fields]
        for one in self._rows:
            default = one.field.text(one.field.option.default)
            shown = "" if isinstance(one.editor, QLineEdit) else default
            one.show_state(RowState(shown, placeholder=default))
            one.entered.connect(lambda asked, _: self._entered.add(asked.option.name))
            self._fields.addWidget(one)
        if self.found is not None and self.found.certificate.what == chosen.name:
            return
        self._show_found(None)
        path = next((path for path, one in self.held.items() if one.what == chosen.name), None)
        if path is not None:
            show = partial(shown_certificate, path)
            self._background.start_anew(show, self._show_found, self._say)

    # ------------------------------------------------------------------ building

    def _build(self) -> None:
        self.list = RowList(
            ("calibration", "certificate", "age", "due"),
            "Calibrations of the bench",
            "There are no calibrations.",
            minimumHeight=160,
            currentItemChanged=self._show_chosen,
        )
        self.about, self.state = (label("", "muted", wraps=True) for _ in range(2))
        self.values, self.picture = label("", "detail", wraps=True), QLabel()
        self.picture.setSizePolicy(QSizePolicy.Policy.Ignored, QSizePolicy.Policy.Preferred)
        self.measure_button = button(
            "Measure", "Makes the runs of this calibration on the bench of Set up", self.measure
        )
        by_pointer_only(self.measure_button)
        self.files_button = button(
            "From files …", "Evaluates sessions or other files", self._ask_files
        )
        self.use_button = button("Use", "Takes what the certificate says for the bench", self.use)
        self.use_button.setEnabled(False)
        acts = row(self.measure_button, self.files_button, self.use_button)
        shown = (self.state, self.values, self.picture)
        self.hold((self.list, 1), self.about, self._fields, acts, *shown)
