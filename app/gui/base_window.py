"""The window as furniture: its parts, their places, its menus and its look."""

from __future__ import annotations

from collections.abc import Iterator
from functools import cached_property
from pathlib import Path
from typing import Any

from PySide6.QtCore import Qt
from PySide6.QtGui import QResizeEvent
from PySide6.QtWidgets import QApplication, QMainWindow, QMenuBar, QWidget

from app.gui import theme
from app.gui.background import Act, Take
from app.gui.bench_panel import BenchPanel
from app.gui.calibration_panel import CalibrationPanel
from app.gui.campaign_panel import CampaignPanel
from app.gui.cells import Cell, Tone, set_decimal_sign
from app.gui.curves_view import CurvesView
from app.gui.docks import LEFT, RIGHT, DockPlace, Docks
from app.gui.experiment_panel import ExperimentPanel, order_pause, refusal
from app.gui.health_panel import IDLE, HealthPanel, HealthStrip
from app.gui.help_windows import Manual, about
from app.gui.image_view import InterfaceView
from app.gui.keys import ACTS, GO_TO, KeyList, focus_first, make_actions, make_ways
from app.gui.log_panel import LogPanel, LogStore
from app.gui.memory import WindowMemory
from app.gui.notice import Notice
from app.gui.panels import LiveStrip, RunPanel, TopBar
from app.gui.playback_bar import PlaybackBar
from app.gui.questions import ask_note
from app.gui.region_panel import RegionPanel
from app.gui.result_panel import ResultPanel
from app.gui.sessions_panel import SessionsPanel, recent_menu
from app.gui.setup_panel import SetupPanel
from app.gui.source import Setup
from app.gui.stop_key import StopKey
from app.gui.view_state import ViewState
from app.gui.widgets import SteadySize, column, holding
from app.gui.window_model import RunDisplay, WindowModel
from app.records.record_types import Outcome
from app.runs.run_source import Kind


class BaseWindow(QMainWindow):
    """All parts of the window in their places; what the actions of `app.gui.keys` do is up to the
    class that makes use of it. Parts in docks are made when they come into view or are asked for.

    Parameters
    ----------
    model : WindowModel or None
        None: the parts that prepare a run, or open another, are left out.
    logs : LogStore
        What the log shows.
    """

    curves: CurvesView
    result: ResultPanel
    health: HealthPanel
    log: LogPanel
    # None in a window without a model
    bench: BenchPanel | None
    setup: SetupPanel | None
    experiment: ExperimentPanel | None
    sessions: SessionsPanel | None
    region: RegionPanel | None
    campaign: CampaignPanel | None
    calibration: CalibrationPanel | None

    def __init__(self, model: WindowModel | None, logs: LogStore) -> None:
        super().__init__()
        self.setWindowTitle("SlipScope")
        self.setAnimated(False)  # else each change of the layout starts one for each dock
        self.model, self.memory = model, WindowMemory()
        self._apply_theme()
        set_decimal_sign(self.locale().decimalPoint())
        self.top, self.notice, self.playback = TopBar(), Notice(), PlaybackBar()
        self.interface, self.readouts, self.strip = InterfaceView(), LiveStrip(), HealthStrip()
        self._logs = logs
        self._session: Path | None = None  # of the run that is shown
        self._setup: Setup | None = None
        self._view: ViewState | None = None
        # what the notice says of what fails, and of why no run begins, until it is over
        self._reported = self._refused = ""
        self._put_in_place()
        # those that show a run, but for picture and curves; and those that have its numbers of now
        self._shows: list[RunPanel] = []
        self._counts: list[RunPanel] = [self.strip]
        self.docks.made.connect(self._take_in)
        if model is not None and model.session is not None:
            self.docks.part("setup")  # which looks whether that file can be written
        if self.bench is not None:
            self.bench.seen.connect(self.interface.show_live)
            self.bench.acts.connect(self.top.show_bench)
            self.bench.read.connect(self.readouts.show_bench)
        self.interface.canvas.setFocus()  # whose keys change what is seen, and nothing else
        for part in (self.interface, self.curves):
            self.playback.add_keys(part)

    def __getattr__(self, name: str) -> Any:
        """A part in a dock; the attributes of the window that are declared above."""
        if name not in GO_TO:
            raise AttributeError(f"{type(self).__name__} has no attribute {name!r}")
        part = self.docks.part(name)
        setattr(self, name, part)  # Qt takes long to say that there is no such attribute
        return part

    def _put_in_place(self) -> None:
        does = {act.name: getattr(self, act.name) for act in ACTS}
        bar = QMenuBar()
        self.actions_by_name, menus = make_actions(self, bar, ACTS, does)
        stops = [self.actions_by_name[name] for name in ("stop_motion", "stop_or_close")]
        self.stop_key = StopKey(self, stops)
        self._wire_buttons(does["stop_motion"])
        head = column(bar, SteadySize(self.top), self.notice, spacing=2, margins=(4, 0, 4, 4))
        self.setMenuWidget(holding(head, "body"))  # above all docks, so that nothing covers STOP
        body = column(SteadySize(self.readouts), (SteadySize(self.interface), 1), spacing=4)
        self.setCentralWidget(holding(body, "body"))
        self.addToolBar(Qt.ToolBarArea.BottomToolBarArea, self.playback)
        self.statusBar().addPermanentWidget(SteadySize(self.strip), 1)
        self.statusBar().setSizeGripEnabled(False)
        self.docks = Docks(self, tuple(self._places()))
        titles = {name: dock.windowTitle() for name, dock in self.docks.by_name.items()}
        ways = menus["&View"].addMenu("&Go to")
        make_ways(self, ways, titles | {"picture": "Picture"}, self.go_to)
        self.docks.add_to(menus["&View"])
        if self.model is not None:
            recent = recent_menu(self, self.memory, self._open_recent)
            menus["&File"].insertMenu(self.actions_by_name["close"], recent)
        self.docks.open(self.memory)
        self.playback.hide()  # also if the last window was closed in a replay

    def _open_recent(self, session: Path) -> None:
        if self.sessions is not None:
            self.sessions.open_session(session)

    def _wire_buttons(self, stop_motion: Act) -> None:
        """Let the buttons on top do what the actions of the menus do."""
        for button, name in ((self.top.start, "begin"), (self.top.stop, "end_run")):
            action = self.actions_by_name[name]
            button.setToolTip(action.toolTip())
            button.clicked.connect(action.trigger)
            action.enabledChanged.connect(button.setEnabled)
        # a button acts on the way down: held, it has stopped the motion already
        self.top.stop_motion.setToolTip(self.actions_by_name["stop_motion"].toolTip())
        self.top.stop_motion.pressed.connect(stop_motion)

    def _places(self) -> Iterator[DockPlace]:
        model, canvas = self.model, self.interface.canvas
        if model is not None:  # a bench and settings scroll by themselves
            yield DockPlace(BenchPanel, (model,), LEFT, scrolls=False, least_px=300)
            yield DockPlace(SetupPanel, (model,), LEFT, scrolls=False, least_px=320)
            yield DockPlace(ExperimentPanel, (model,), LEFT)
            yield DockPlace(SessionsPanel, (model,), LEFT)
        yield DockPlace(CurvesView, (), RIGHT, scrolls=False)
        if model is not None:
            yield DockPlace(RegionPanel, (model, canvas), RIGHT)
        yield DockPlace(ResultPanel, (), RIGHT)
        yield DockPlace(HealthPanel, (), RIGHT)
        yield DockPlace(LogPanel, (self._logs,), RIGHT, scrolls=False, least_px=284)
        if model is not None:
            yield DockPlace(CampaignPanel, (model,), RIGHT)
            yield DockPlace(CalibrationPanel, (model,), RIGHT)

    # ------------------------------------------------------------------ the run that is shown

    def follow(self, session: Path | None) -> None:
        """Show a run that records this file, or plays it, from now on."""
        self._session = session
        self.readouts.begin(session)
        if self.docks.if_made(LogPanel.name):
            self.log.follow(session)

    def outcome(self) -> Outcome | None:
        """How the run ended; None until then."""
        return self._view.outcome if self._view else None

    def show_setup(self, setup: Setup) -> None:
        """Empty all parts for a run of this set-up."""
        self._setup = setup
        self.top.title.setText(setup.title)
        self.setWindowTitle(f"{setup.title} – SlipScope")
        self.interface.show_setup(setup)
        self.curves.show_setup(setup)
        for part in (*self._shows, *self._counts):
            part.show_setup(setup)

    def _show_numbers(self, view: ViewState) -> None:
        """Show the numbers of one instant everywhere: side by side they must agree."""
        self.top.say(view.sentence, view.place, is_fault=view.state == "failed")
        self.readouts.show_run(view.readouts)
        for part in self._counts:
            part.show_view(view)

    def _displays(self) -> list[RunDisplay]:
        """What is drawn in turn: each curve, and each part that shows a run."""
        return [*self.curves.cells, *self._shows]

    def _take_in(self, part: QWidget) -> None:
        """Show the run, and what comes of it, in a part that has just been made."""
        if isinstance(part, RunPanel):
            (self._counts if isinstance(part, ExperimentPanel) else self._shows).append(part)
            if self._setup is not None:
                part.show_setup(self._setup)
            if self._view is not None:
                part.show_view(self._view)
        elif isinstance(part, LogPanel):
            part.follow(self._session)

    # ------------------------------------------------------------------ the window itself

    def resizeEvent(self, event: QResizeEvent) -> None:
        """Give the docks their shares of it."""
        super().resizeEvent(event)
        self.docks.follow_window()

    def toggle_theme(self) -> None:
        """Change between the dark look and the light one."""
        self.memory.theme = "light" if self.memory.theme == "dark" else "dark"
        self._apply_theme()
        self.top.show_again()

    def _apply_theme(self) -> None:
        application = QApplication.instance()
        assert isinstance(application, QApplication)
        theme.apply(application, self.memory.theme)

    def ring(self) -> None:
        """Be heard, and seen in the bar of the desktop."""
        QApplication.beep()
        QApplication.alert(self)

    def full_screen(self) -> None:
        """Fill the screen, or give it back."""
        self.setWindowState(self.windowState() ^ Qt.WindowState.WindowFullScreen)

    def go_to(self, part: str) -> None:
        """Bring a part to the front, and put the keys into it."""
        if part in self.docks.by_name:
            self.docks.go_to(part)
        else:
            self.activateWindow()
            focus_first(self.interface)

    def _bring(self, name: str) -> None:
        """Bring a part to the front, unless runs of a campaign follow, which is seen there."""
        campaign = self.docks.if_made("campaign")
        if campaign is None or not campaign.unattended.isChecked():
            self.docks.show(name)

    def _report(self, sentence: str) -> None:
        """Say what is wrong with reading or drawing, until it is over."""
        self._reported = sentence
        self.notice.say(sentence)

    def show_making(self, what: str) -> None:
        """Say that something is made ready, in place of what was said of the last run; empty: that
        nothing is.
        """
        sentence = f"{what} is being made ready." if what else ""
        self.top.show_state(*(("making ready", Tone.BUSY) if what else ("idle", Tone.NEUTRAL)), "")
        self.top.say(sentence)
        self.strip.empty(Cell("verdict", sentence) if what else IDLE)

    def go_to_refused(self) -> str:
        """Why no run can begin with what stands in the form, what is typed at the moment included,
        and go there; empty where one can, and where nothing has been typed yet.
        """
        field = self.focusWidget()
        if field is not None and field.hasFocus():  # a click on Start takes no focus from it
            field.clearFocus()
            field.setFocus()
        setup: SetupPanel | None = self.docks.if_made(SetupPanel.name)
        if setup is None or not (refusal := setup.refusal()):
            return ""
        self.docks.show(setup.name)
        setup.go_to_refused()
        return refusal

    def reset_layout(self) -> None:
        """Put all parts where they were at first."""
        self.memory.forget_layout()
        self.docks.arrange()

    def show_keys(self) -> None:
        """List the keys, in a window of its own beside which this one stays in use."""
        self._keys.show()
        self._keys.activateWindow()

    @cached_property
    def _keys(self) -> KeyList:
        return KeyList(self, (PlaybackBar, *self.docks.kinds))

    def pause(self) -> None:
        """Let the run wait after the step under way, withdraw that, or say why it cannot."""
        if self.experiment is not None:
            self.experiment.pause()
        elif (view := self._view) is not None:
            is_live = view.kind is Kind.LIVE
            order_pause(view.steps, self._in_background, self.notice.say, is_live=is_live)

    def note(self) -> None:
        """Go to the line of a note of the run, or ask for one in a window without that line."""
        if self.experiment is not None:
            self.docks.show(self.experiment.name)
            self.experiment.go_to_note()
        elif (view := self._view) is not None:
            if why := refusal(view.steps, "note", is_live=view.kind is Kind.LIVE):
                self.notice.say(why)
            else:
                ask_note(self, self._take_note)

    def _take_note(self, text: str) -> None:
        if text.strip():
            self._in_background("The note could not be recorded", lambda source: source.note(text))
            self._logs.say(f"Note: {text}", is_trouble=False)

    def _in_background(self, failed: str, act: Take) -> None:
        """Order something of the run; say `failed` and why where that fails."""
        raise NotImplementedError

    def show_manual(self) -> None:
        """Show the pages of the manual."""
        Manual(self).show()

    def show_about(self) -> None:
        """Say what program this is."""
        about(self)
