"""The campaign: its runs with what has become of them, and the next one for the bench."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path

from PySide6.QtCore import Signal
from PySide6.QtWidgets import (
    QCheckBox,
    QFileDialog,
    QHeaderView,
    QLineEdit,
    QPushButton,
)

from app.campaigns.plan import MOST_RUNS
from app.campaigns.state import RunState
from app.campaigns.writing import write_campaign
from app.gui import campaign_lines
from app.gui.background import BackgroundWork
from app.gui.campaign_lines import CampaignLines, CampaignRun
from app.gui.cells import localized, tone_of, typeset
from app.gui.file_question import ask_file
from app.gui.form import numbers_of
from app.gui.number_boxes import CountBox
from app.gui.plot_panel import PlotPanel
from app.gui.plots.curves import CurvePlot
from app.gui.widgets import (
    STRETCH,
    Panel,
    RowList,
    button,
    by_pointer_only,
    form,
    label,
    menu_button,
    row,
    widget,
    write_or_hide,
)
from app.gui.window_model import WindowModel
from app.settings.config import campaign_names, measured_differently
from app.system.durations import duration
from app.system.errors import UserError

CAMPAIGN_FILES = "Campaigns (*.toml);;All files (*)"
NUMBER, RUN, STATE, FRICTION, TIME = range(5)
PLACE = "loads.toml"  # that is proposed for a campaign
CHART_PX = 180


class NewCampaign(Panel):
    """What a new campaign varies; all else is as in Set up."""

    asked = Signal()

    def __init__(self) -> None:
        super().__init__()
        self.loads, self.velocities, self.samples = (
            widget(QLineEdit, accessibleName=name, placeholderText=hint)
            for name, hint in (
                ("Loads", "0.1 0.3 0.5"),
                ("Velocities", "as in Set up"),
                ("Samples", "as in Set up; else A; B; C"),
            )
        )
        self.repeats = widget(CountBox, minimum=1, maximum=MOST_RUNS)
        self.pauses = widget(
            QCheckBox,
            "wait for me before each run",
            toolTip="So that the block can be lifted and put down again by hand",
        )
        rows = form(
            {
                "loads P (N)": self.loads,
                "velocities (µm/s)": self.velocities,
                "samples": self.samples,
            }
        )
        rows.addRow(label("repeats", "name"), row(self.repeats, self.pauses, STRETCH))
        save = row(STRETCH, button("Save as …", act=self.asked.emit))
        self.hold(rows, save, spacing=4)

    def varied(self) -> dict[str, list[float | str]]:
        """``table.key`` -> its values, the slowest first; ConfigError if one is no number."""
        samples = [name.strip() for name in self.samples.text().split(";")]
        return {
            "about.sample": [*filter(None, samples)],
            "run.velocity": [*numbers_of(self.velocities.text(), "Velocities")],
            "run.normal_force": [*numbers_of(self.loads.text(), "Loads")],
        }


class CampaignPanel(Panel):
    """The runs of a campaign file; Start runs the one that is chosen.

    Unattended, a run that is done or has failed is followed by the next one; one that was stopped,
    or cut short, ends that.
    """

    name = "campaign"
    title = "Campaign"
    keys = (("Enter", "Takes the run that is chosen in the list: Start runs it."),)

    def __init__(self, model: WindowModel) -> None:
        super().__init__()
        self.model, self._background = model, BackgroundWork(self)
        self.lines: CampaignLines | None = None
        self._begun = 0  # number of the run that was begun last
        self._build()
        model.settings_changed.connect(self._follow)
        model.busy_changed.connect(self._note_begun)
        model.stop_pressed.connect(partial(self.unattended.setChecked, False))
        model.not_begun.connect(self._forget_begun)
        model.ended.connect(self._go_on)
        self._show()

    # ------------------------------------------------------------------ what the operator does

    def open(self, file: Path) -> None:
        """Show the runs of a campaign."""
        self._do(lambda: campaign_lines.look(file), self._take_lines)

    def take(self, run: CampaignRun, *, begins: bool = False) -> None:
        """Let Start run this, and begin it if that is said; what there was of it is kept."""
        if self.lines is None:
            return
        file, number = self.lines.plan.file, run.planned.number

        def put(lines: CampaignLines) -> None:
            self._take_lines(lines)
            taken = lines.runs[number - 1]
            about = taken.planned.config.about
            if not about.operator:
                about = replace(about, operator=self.model.config.about.operator)
            config = replace(taken.planned.config, about=about)
            self.model.lend(self.model.zeroed(config), taken.planned.session)
            # nobody has pressed STOP meanwhile, or plays a session
            if begins and self.unattended.isChecked() and not self.model.is_busy:
                self.model.begin_asked.emit()
            else:
                self.model.said.emit(f"Start (F5) begins {typeset(taken.orders)}.", False)

        self._do(lambda: campaign_lines.claim(file, number), put)

    def make(self, file: Path) -> None:
        """Write the campaign that the form describes, and open it."""
        form, config = self.form, self.model.config
        try:
            varied = form.varied()
        except UserError as error:
            self.model.said.emit(f"Campaign: {error}", False)
            return
        repeats, pauses = form.repeats.value(), form.pauses.isChecked()

        def written() -> CampaignLines:
            write_campaign(file, config, varied, repeats=repeats, pauses=pauses)
            return campaign_lines.look(file)

        def opened(lines: CampaignLines) -> None:
            self.new.setChecked(False)
            self._take_lines(lines)

        self._do(written, opened)

    def _follow(self) -> None:
        """Keep the file of a run from settings that are not what the campaign says of it: no
        campaign goes on beside such a session.
        """
        run = next((run for run in self._runs if run.planned.session == self.model.session), None)
        if self.model.is_lent and run is not None and (others := self._others(run)):
            self.model.said.emit(
                f"Campaign: {', '.join(others)} not as in run {run.planned.number}: Start begins no"
                " run of the campaign, and records your own file. Next run takes it anew.",
                False,
            )
            self.model.set_session(self.model.own[1])
        self._show_set()

    def _others(self, run: CampaignRun) -> list[str]:
        """What is measured otherwise by the settings of the next run than by those of `run`."""
        return list(measured_differently(self.model.config, run.planned.config))

    def _note_begun(self) -> None:
        """Remember which run goes on; a replay is none of the campaign."""
        run = self._next_run()
        if self.model.is_live and run is not None:
            self._begun = run.planned.number
        self._show_set()

    def _forget_begun(self) -> None:
        """A run could not be made: none follows it."""
        if self._begun:
            self._begun = 0
            self.unattended.setChecked(False)

    def _go_on(self) -> None:
        """Look what has become of the run that ended; unattended, begin the next one. Of a campaign
        that is only looked at nothing is written.
        """
        if self.lines is None:
            return
        file, ended = self.lines.plan.file, self._begun
        self._begun = 0

        def follow(lines: CampaignLines) -> None:
            self._take_lines(lines)
            if not (ended and self.unattended.isChecked()):
                return
            run, due = lines.runs[ended - 1], lines.next
            if run.state not in (RunState.DONE, RunState.FAILED):
                self.unattended.setChecked(False)
                sentence = f"the campaign waits: run {ended} was not brought to its end"
                self.model.said.emit(f"Campaign: {sentence}.", False)
            elif due is not None:
                self.take(due, begins=True)
            else:  # whatever is run next is no part of it, and is shown
                self.unattended.setChecked(False)

        look = campaign_lines.renew if ended else campaign_lines.look
        self._do(partial(look, file), follow)

    # ------------------------------------------------------------------ drawing

    def _do(
        self, work: Callable[[], CampaignLines], done: Callable[[CampaignLines], object]
    ) -> None:
        self._background.start_anew(
            work,
            done,
            lambda why: self.model.said.emit(f"Campaign: {why}", False),
            in_order=True,  # the folder of a campaign is locked meanwhile
        )

    def _take_lines(self, lines: CampaignLines) -> None:
        self.lines = lines
        self._show()

    @property
    def _runs(self) -> tuple[CampaignRun, ...]:
        return self.lines.runs if self.lines else ()

    def _show(self) -> None:
        lines = self.lines
        plan = lines.plan if lines else None
        self.heading.setText(plan.name if plan else "No campaign is open.")
        self.folder.setText(f"Sessions in {plan.folder.absolute()}" if plan else "")
        self.sentence.setText(localized(lines.progress.sentence()) if lines else "")
        self.unattended.setEnabled(plan is not None and not plan.pauses)
        self.unattended.setToolTip(
            "The operator is waited for before each run of this campaign (pauses = true)"
            if plan and plan.pauses
            else "Each run that is done or has failed is followed by the next one, until one is"
            " stopped"
        )
        chosen = self.list.currentIndex().row()
        self.list.clear()
        self._show_set()
        self.list.setCurrentIndex(self.list.model().index(chosen, NUMBER))
        if lines is not None:
            self.friction.show_chart(lines.friction)
        self.friction.setVisible(lines is not None)
        self._show_chosen()

    def _show_set(self) -> None:
        """Mark the run that Start would begin, and say what the button does."""
        lines = self.lines
        next_run = self._next_run()
        for at, run in enumerate(self._runs):
            self._put_row(at, run, is_next=run is next_run)
        due = lines.next if lines else None
        is_set = due is not None and due is next_run
        self.next.setEnabled(due is not None and not is_set)
        if due is None:
            self.next.setText("All is done" if lines else "Next run")
            return
        what = f"run {due.planned.number}, {due.planned.name}"
        on = "is under way" if self.model.is_live else "is what Start (F5) begins"
        self.next.setText(f"{what} {on}" if is_set else f"Next: {what}")

    def _put_row(self, at: int, run: CampaignRun, *, is_next: bool) -> None:
        """Show a run in the list."""
        mu, planned = run.measured.get("mu_s"), run.planned
        number = f"▶ {planned.number}" if is_next else str(planned.number)
        friction = localized(" ".join(mu.rounded).strip()) if mu else ""
        state = RunState.RUNNING if is_next and self.model.is_live else run.state
        texts = (number, planned.name, state, friction, localized(duration(run.seconds)))
        tips, tones = {RUN: _words(run), STATE: run.found.reason}, {STATE: tone_of(state)}
        self.list.put_row(at, texts, tips, tones, bold=(RUN,) * is_next)

    def _next_run(self) -> CampaignRun | None:
        """The run that the next one is by its file and what it measures, or the one under way is,
        until it is done; zero, analysis, sample, operator and note are the operator's to say.
        """
        for run in self._runs:
            planned = run.planned
            is_same = planned.session == self.model.session and not self._others(run)
            is_begun = self.model.is_live and planned.number == self._begun
            if run.is_due and (is_same or is_begun):
                return run
        return None

    def _show_chosen(self) -> None:
        chosen = self.list.currentIndex().row()
        write_or_hide(self.about, _words(self._runs[chosen]) if chosen >= 0 else "")

    def _take_next(self) -> None:
        due = self.lines.next if self.lines else None
        if due is not None:
            self.take(due)

    # ------------------------------------------------------------------ building

    def _build(self) -> None:
        self.heading = label("", "heading")
        self.folder, self.sentence, self.about = (label("", "muted", wraps=True) for _ in range(3))
        ask = partial(ask_file, self, kinds=CAMPAIGN_FILES)
        self.open_button = menu_button(
            "Open",
            "Opens a campaign: a file of runs over loads, samples, repeats",
            {"A campaign file …": partial(ask, "Open a campaign", self.open)}
            | {f"Campaign {name}": partial(self.open, Path(name)) for name in campaign_names()},
        )
        tip = "Lets Start begin the next run: takes its settings and its file"
        self.next = button("Next run", tip, self._take_next)
        by_pointer_only(self.next)
        self.unattended, self.form = QCheckBox("go on by itself"), NewCampaign()
        self.new = widget(
            QPushButton,
            "New …",
            toolTip="Plans runs over loads, velocities, samples and repeats",
            checkable=True,
            toggled=self.form.setVisible,
        )
        self.friction = PlotPanel(CurvePlot(), title="Friction against load")
        self.form.hide()
        self.form.asked.connect(
            partial(
                ask,
                "Save the campaign",
                self.make,
                start=Path(PLACE),
                mode=QFileDialog.FileMode.AnyFile,
                endings=("toml",),
            )
        )
        self.friction.setFixedHeight(CHART_PX)
        self.list = RowList(
            ("", "run", "state", "μₛ", "time"),
            "Runs of the campaign",
            "The runs of a campaign, over loads, velocities, samples and repeats, with what has"
            " become of each. Open takes a campaign file, or one that comes with the program.",
            right=(TIME,),
            minimumHeight=120,
            toolTip="Enter or a double click makes a run the next one, also one that failed",
            currentItemChanged=self._show_chosen,
        )
        self.list.header().setStretchLastSection(False)
        self.list.header().setSectionResizeMode(RUN, QHeaderView.ResizeMode.Stretch)
        self.list.itemActivated.connect(
            lambda *_: self.take(self._runs[self.list.currentIndex().row()])
        )
        top = row(self.heading, STRETCH, self.new, self.open_button)
        controls = row((self.next, 1), self.unattended, spacing=8)
        parts = (self.form, self.sentence, self.folder, controls, (self.list, 1), self.about)
        self.hold(top, *parts, self.friction)


def _words(run: CampaignRun) -> str:
    """What is to be done for a run, and why it has ended."""
    return "\n".join(filter(None, (typeset(run.orders), typeset(run.found.reason))))
