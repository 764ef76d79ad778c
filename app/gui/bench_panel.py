"""The bench before a run: pick it, connect it, see it, move its stage, zero its sensors."""

from __future__ import annotations

import re
import time
from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path

from PySide6.QtCore import Qt, QTimer, Signal
from PySide6.QtGui import QShowEvent
from PySide6.QtWidgets import (
    QFrame,
    QScrollArea,
    QWidget,
)

from app.gui.background import Act, BackgroundWork
from app.gui.bench_cells import (
    DeviceLine,
    device_lines,
    disk_text,
    gauges,
    is_outdated,
    picture_cells,
    picture_note,
    zeroed_text,
)
from app.gui.bench_devices import DeviceList
from app.gui.bench_draw import ForceBand, GreyHistogram, framed
from app.gui.bench_link import (
    BUTTON,
    BenchLink,
    BenchMessage,
    CameraAdjusted,
    LinkState,
    News,
    Pair,
    ZeroDoubt,
    ZeroedForces,
)
from app.gui.bench_stage import StagePanel
from app.gui.cells import Tone, typeset
from app.gui.file_question import ask_file
from app.gui.memory import WindowMemory
from app.gui.number_boxes import NumberBox
from app.gui.panels import CellGrid
from app.gui.widgets import (
    STRETCH,
    Choice,
    Part,
    button,
    by_pointer_only,
    column,
    holding,
    label,
    row,
    tint,
    widget,
    words,
    write,
    write_or_hide,
)
from app.gui.window_model import WindowModel
from app.records.bench_view import BenchPreview, BenchView, DeviceState, PictureView
from app.settings.config import bench_names, load
from app.settings.sections import Config
from app.system.stopping import StopAnswer

LOOK_MS = 100
TAKEN = "A run has the bench."
GONE = "not live: the bench is not connected"
AS_SET, FILE = "current set-up", "open a file …"


class BenchPanel(QScrollArea):
    """A connected bench at a glance.

    Attributes
    ----------
    link : BenchLink
    said : QLabel
        The newest sentence for the operator.
    """

    name, title = "bench", "Bench"
    read = Signal(object)  # ForcesView of the connected bench; None where there is none
    # a PictureView, the Config of its bench, why it is not live, empty if it is, and whether the
    # bench is connected
    seen = Signal(object, object, str, bool)
    acts = Signal(str)  # what the stage does that nobody has begun a run with; empty: nothing

    def __init__(self, model: WindowModel) -> None:
        super().__init__()
        self._model, self._memory, self._background = model, WindowMemory(), BackgroundWork(self)
        self.link = BenchLink(model.factory.preview)
        self._connected: Config | None = None  # settings with which the bench was connected
        self._zero_v: Pair | None = None  # that the connected bench has
        self._on_zero_act: Act = lambda: None
        self._failure: StopAnswer | None = None  # that was told
        self._reason = ""  # of a stop, that was told
        self._seen: tuple[PictureView, str, bool] | None = None  # as `_show_picture` told of it
        self._phase = LinkState.OFF
        self._noted: set[tuple[str, str]] = set()  # states of devices that are in the log
        self._wrong: tuple[tuple[str, str], ...] = ()  # with devices, without numbers
        self._told_wrong = ""  # of devices
        self._build()
        self._look_timer = widget(QTimer, self, timeout=self._tick)
        self._look_timer.start(LOOK_MS)
        model.settings_changed.connect(self._show_settings)
        model.busy_changed.connect(self._make_way)
        self._list_benches()
        self._show_settings()
        self._tick()

    # ------------------------------------------------------------------ what others may call

    @property
    def preview(self) -> BenchPreview | None:
        """The bench, while it is connected: its `stop_motion` stops the stage."""
        return self.link.preview

    def connect_bench(self) -> None:
        """Connect the bench that the settings of the next run name."""
        self._connected = self._model.config
        self._zero_v = self._connected.forces.zero
        self._offer_zero_act()
        self._noted.clear()
        self._model.noted.emit(f"Bench: connecting ({self.bench.currentText()})")
        self.link.connect(self._model.config)
        self._say("", Tone.NEUTRAL)
        self._tick()

    def disconnect_bench(self, why: str = "") -> None:
        """Let go of the bench."""
        self.link.disconnect(why)
        self._tick()

    # ------------------------------------------------------------------ picking

    def _list_benches(self) -> None:
        self.bench.clear()
        self.bench.addItem(AS_SET)
        for path in self._memory.recent("bench"):
            self.bench.add(path.name, path, str(path))
        for name in bench_names():
            self.bench.addItem(name, Path(name))
        self.bench.addItem(FILE)

    def _pick(self, index: int) -> None:
        """Take the settings of a bench for those of the next run."""
        path = self.bench.itemData(index)
        if self.bench.itemText(index) == FILE:
            ask_file(self, "Bench", self.pick, kinds="Settings (*.toml)")
        if path is None:
            self.bench.setCurrentIndex(0)
            return
        self.pick(path)

    def pick(self, path: Path) -> None:
        """Take the settings of that file, or of the bench of that name, for the next run."""

        def failed(why: str) -> None:
            self._say(why, Tone.BAD)
            self.bench.setCurrentIndex(0)

        def take(found: tuple[Config, bool]) -> None:
            config, is_file = found
            if is_file:
                self._memory.remember("bench", path)
            self._model.set_config(config)
            self._list_benches()
            self.bench.setCurrentText(path.name)
            self._say(f"The next run uses the settings of {path.name}.", Tone.NEUTRAL)

        self._background.start_anew(lambda: (load(path), path.exists()), take, failed)

    # ------------------------------------------------------------------ orders

    def _toggle(self) -> None:
        if self.link.phase in (LinkState.OFF, LinkState.LEAVING) or self._has_failed():
            self.connect_bench()
        else:
            self.disconnect_bench()

    def _has_failed(self) -> bool:
        """Whether no device is there that could be looked at."""
        devices = self.link.view.devices.values() if self.link.view else ()
        return bool(devices) and all(one.state is DeviceState.FAILED for one in devices)

    def _offer_zero_act(self, note: str = "", act: str = "", do: Act = lambda: None) -> None:
        """Say something beside Zero, and offer an act; nothing about it changes its place."""
        write(self.zero_note, note)
        self.zero_act.setText(act)
        self.zero_act.setVisible(bool(act))
        self._on_zero_act = do

    def _do_zero_act(self) -> None:
        do = self._on_zero_act
        self._offer_zero_act()
        do()

    def _zero_sensors(self) -> None:
        self._offer_zero_act()
        self.link.zero()

    def _zero_under_load(self) -> None:
        self._model.noted.emit(
            "Bench: the operator says that the block is free; zeroed all the same"
        )
        self.link.zero(under_load=True)

    def _give_back_zero(self, volts: Pair) -> None:
        config = self._model.config
        self._model.set_config(replace(config, forces=replace(config.forces, zero=volts)))
        normal, shear = volts
        sentence = f"The zero before is back: {normal:+.4f} V and {shear:+.4f} V."
        self._say_and_note(sentence, Tone.NEUTRAL)

    def _keep_zero(self) -> None:
        """Let the connected bench have the zero of the next run, if it was changed elsewhere."""
        config = self._model.config
        if self._connected is None or self.preview is None or config.forces.zero == self._zero_v:
            return
        if not is_outdated(self._connected, config):
            self._zero_v = config.forces.zero
            self.link.set_zero(config.forces.zero)

    def _expose(self) -> None:
        """Take exposure and gain for the next run, and for the picture if there is one."""
        if not (self.exposure.is_typed or self.gain.is_typed):
            return
        config = self._model.config
        camera = config.camera
        if self.exposure.is_typed:
            camera = replace(camera, exposure=self.exposure.value() * 1e-3)
        if self.gain.is_typed:
            camera = replace(camera, gain=self.gain.value())
        try:
            config = replace(config, camera=camera)
        except ValueError as error:
            self._say(str(error), Tone.BAD)
            self._show_settings()
            return
        self._model.set_config(config)
        if self.link.phase is LinkState.ON:
            self.link.adjust_camera(camera.exposure, camera.gain)
        elif self.link.phase is LinkState.CONNECTING:
            self.connect_bench()

    def _make_way(self, is_busy: bool) -> None:
        """A run needs the devices."""
        if is_busy and self.link.phase is not LinkState.OFF:
            self.disconnect_bench(TAKEN)
        if not is_busy and self.link.problem == TAKEN:
            self.link.problem = ""
        self._tick()

    # ------------------------------------------------------------------ showing

    def _tick(self) -> None:
        """Take a look at the bench, and show the last one."""
        for news in self.link.news():
            self._tell(news)
        failure = self.link.view.failure if self.link.view else None
        if failure is not None and failure != self._failure:
            self._tell(failure)
        self._failure = failure
        self._keep_zero()
        session = self._model.session
        self.link.look(session.parent if session else Path())
        view = self.link.view if self.link.phase is LinkState.ON else None
        self.read.emit(view and view.forces)
        self.acts.emit(self.stage.follow(view.stage if view else None))
        self._note_devices(view)
        self._show_picture(view)
        reason = view.said if view else ""
        if reason and reason != self._reason:
            self._say_and_note(reason, Tone.BAD)
        self._reason = reason
        if self.isVisible():
            self._show()

    def _note_devices(self, view: BenchView | None) -> None:
        """Note in the log what has become of the connection, and each state of a device once."""
        before, self._phase = self._phase, self.link.phase
        if self._phase is LinkState.OFF and before is not LinkState.OFF:
            why = f": {typeset(self.link.problem)}" if self.link.problem else ""
            self._model.noted.emit(f"Bench: not connected any more{why}")
        lines = device_lines(view) if view else ()
        wrong = [line for line in lines if line.tone in (Tone.WARN, Tone.BAD)]
        self._tell_what_is_wrong(wrong)
        for line in lines:
            state = line.kind, line.word
            if line.tone is not Tone.BUSY and state not in self._noted:
                self._noted.add(state)
                self._model.noted.emit(f"Bench: {line.name}, {line.word}: {line.sentence}")

    def _tell_what_is_wrong(self, wrong: Sequence[DeviceLine]) -> None:
        """Say what is wrong with the devices, until it is mended or something newer is said."""
        text = "\n".join(f"{line.name}: {line.sentence}" for line in wrong)
        # a number that counts on is no news, and is shown only where the sentence stands
        now = tuple((line.kind, re.sub(r"\d+", "", line.sentence)) for line in wrong)
        is_news, stands = now != self._wrong, self.said.text() == typeset(self._told_wrong)
        if text != self._told_wrong and ((is_news and wrong) or stands):
            is_bad = any(line.tone is Tone.BAD for line in wrong)
            self._say(text, Tone.BAD if is_bad else Tone.WARN if wrong else Tone.NEUTRAL)
        self._wrong, self._told_wrong = now, text

    def _show_picture(self, view: BenchView | None) -> None:
        """Show the picture in the middle of the window, also while this panel is hidden; one that
        is not live any more says so.
        """
        picture, note, is_connected = self.link.picture if view else None, picture_note(view), True
        if picture is None:
            if self._seen is None or not self._seen[2]:
                return
            picture, note = self._seen[0], f"{GONE} since {time.strftime('%H:%M:%S')}"
            is_connected = False
        now = picture, note, is_connected
        if now != self._seen and self._connected and not self._model.is_busy:
            self._seen = now
            self.seen.emit(picture, self._connected, note, is_connected)

    def _tell(self, news: News) -> None:
        match news:
            case ZeroedForces():
                config = self._model.config
                forces, before = replace(config.forces, zero=news.volts), config.forces.zero
                self._zero_v = news.volts
                self._model.zeros.add(news.volts)
                self._model.set_config(replace(config, forces=forces))
                self._say_and_note(*zeroed_text(news, config))
                self._offer_zero_act("", "Undo", partial(self._give_back_zero, before))
            case ZeroDoubt():
                self._say_and_note(news.sentence, Tone.WARN)
                self._offer_zero_act(
                    "Force: is the block free?",
                    "It is free, zero",
                    self._zero_under_load,
                )
            case CameraAdjusted():
                self._show_adjusted(news)
            case StopAnswer():
                if news.has_failed:
                    self._say(news.sentence, Tone.BAD)
                    self._model.said.emit(news.sentence, True)
            case BenchMessage():
                self._say_and_note(news.sentence, Tone.BAD)

    def _show_adjusted(self, news: CameraAdjusted) -> None:
        """Say what became of another exposure or gain; connect anew where the camera needs that."""
        if not news.is_live:
            if self.link.is_wanted:
                self.connect_bench()
        elif news.problem:
            self._say(news.problem, Tone.BAD)
        elif self._connected is not None:
            camera = replace(self._connected.camera, exposure=news.exposure_s, gain=news.gain_db)
            self._connected = replace(self._connected, camera=camera)
            settings = f"exposure {news.exposure_s * 1e3:g} ms"
            settings += f", gain {news.gain_db:g} dB" * (news.gain_db >= 0)
            self._model.noted.emit(f"Bench: the camera has {settings}")

    def _show(self) -> None:
        link, phase = self.link, self.link.phase
        is_on = phase is LinkState.ON
        view, picture = (link.view, link.picture) if is_on else (None, None)
        is_lost = is_on and self._has_failed()
        self.connect_button.setText("Try again" if is_lost else BUTTON[phase])
        can_connect = phase is not LinkState.LEAVING and not self._model.is_busy
        if self.connect_button.hasFocus() and not can_connect:
            self.setFocus()  # else the next field gets it, and the panel is scrolled there
        self.connect_button.setEnabled(can_connect)
        can_choose = phase is LinkState.OFF and not self._model.is_busy
        self.bench.setEnabled(can_choose)
        self.devices.show_devices(view, can_choose=can_choose)
        self.state.setText(self._state())
        self.picture.show_picture(picture, picture_note(view))
        self.cells.show_cells(picture_cells(picture))
        config = self._connected if view and self._connected else self._model.config
        both = gauges(view.forces if view else None, config)
        for gauge, shown in zip((self.normal, self.shear), both, strict=True):
            gauge.show_gauge(shown)
        self.stage.show_stage(view.stage if view else None)
        self.zero.setEnabled(view is not None and view.forces is not None and not link.is_zeroing)
        self.zero.setText("Zeroing …" if link.is_zeroing else "Zero")
        self.zero_act.setEnabled(self.zero.isEnabled())
        text, tone = disk_text(view.bytes_per_s if view else 0.0, link.free_bytes)
        self.disk.setText(typeset(text))
        tint(self.disk, None if tone is Tone.NEUTRAL else tone)

    def _state(self) -> str:
        """How the connection is, in a sentence; empty where the devices say it."""
        link = self.link
        if link.phase is LinkState.OFF:
            if link.problem:
                return typeset(link.problem)
            return TAKEN if self._model.is_busy else "Not connected."
        if link.phase is LinkState.CONNECTING:
            return "Connecting …"
        if link.phase is LinkState.LEAVING:
            return "Letting go of the devices …"
        if link.is_silent:
            return "The process of the bench does not answer; disconnect and connect again."
        if self._connected is not None and is_outdated(self._connected, self._model.config):
            return "Settings changed: connect again to see them."
        return ""

    def _show_settings(self) -> None:
        """Show what the settings of the next run say of the camera and of the jog."""
        config = self._model.config
        self.exposure.put(config.camera.exposure * 1e3)
        self.gain.put(config.camera.gain)
        self.stage.show_settings(config)

    def _say(self, sentence: str, tone: Tone) -> None:
        write_or_hide(self.said, typeset(sentence))
        tint(self.said, None if tone is Tone.NEUTRAL else tone)

    def _say_and_note(self, sentence: str, tone: Tone) -> None:
        self._say(sentence, tone)
        self._model.noted.emit(f"Bench: {typeset(sentence)}")

    def showEvent(self, event: QShowEvent) -> None:
        """Look at the bench while somebody sees the panel."""
        super().showEvent(event)
        self._list_benches()
        self._tick()

    # ------------------------------------------------------------------ building

    def _build(self) -> None:
        tip = "Bench whose settings the next run uses"
        self.bench = Choice(accessibleName="Bench", toolTip=tip, activated=self._pick)
        tip = "Opens each device, without a run; nothing moves"
        self.connect_button = button("Connect", tip, self._toggle)
        self.state, self.said = words("muted"), words("")
        # so that a bench that dies moves no button: its sentence has three lines in a narrow dock
        self.state.setMinimumHeight(3 * self.state.fontMetrics().lineSpacing())
        clear = partial(self._say, tone=Tone.NEUTRAL)
        self.stage = StagePanel(self._model, self.link, clear, self.said)
        head = column(row((self.bench, 1), self.connect_button), self.state, spacing=4)
        self.devices = DeviceList(self._model, partial(self._say, tone=Tone.BAD))
        self.picture, self.cells = GreyHistogram(), CellGrid(style="count", spacing=8)
        self.disk = label("–", "")
        self.normal, self.shear = ForceBand(), ForceBand()
        parts: list[QWidget] = [
            framed(head, self.devices),
            framed(self.normal, self.shear, self._zero_row()),
            self.stage,
            framed(self.picture, self.cells, self._camera_row()),
            framed(row(label("disk", "name"), (self.disk, 1), spacing=8)),
        ]
        self.cells.setObjectName("")
        body = column(*parts, STRETCH, margins=(4, 4, 4, 4))
        self.setWidget(holding(body, "body"))
        self.setWidgetResizable(True)
        self.setFrameShape(QFrame.Shape.NoFrame)
        # so that a sentence for which there is no height moves no button to the left
        self.setVerticalScrollBarPolicy(Qt.ScrollBarPolicy.ScrollBarAlwaysOn)
        bar = self.verticalScrollBar()
        bar.rangeChanged.connect(lambda _, most: bar.setEnabled(most > 0))
        bar.setEnabled(False)  # nothing of it is seen
        self.setMinimumWidth(300)
        self._say("", Tone.NEUTRAL)

    def _zero_row(self) -> Part:
        self.zero = button(
            "Zero",
            "Takes the readings of the next second for those without a force; the block must hang"
            " free. The next run begins with them (forces.zero)",
            self._zero_sensors,
        )
        self.zero_act, self.zero_note = button("", act=self._do_zero_act), words("detail")
        self.zero_note.setFixedHeight(3 * self.zero_note.fontMetrics().lineSpacing())
        by_pointer_only(self.zero, self.zero_act)
        self._offer_zero_act()
        return row((self.zero_note, 1), self.zero_act, self.zero)

    def _camera_row(self) -> Part:
        self.exposure = NumberBox("Exposure", "ms", (0.01, 1000.0), 2)
        self.gain = NumberBox("Gain", "dB", (-1.0, 60.0), 2)
        self.gain.setSpecialValueText("as set")
        self.exposure.setToolTip("camera.exposure of the next run; the live picture has it at once")
        self.gain.setToolTip(
            "camera.gain of the next run; 'as set': the gain stays as the camera is set"
        )
        for box in (self.exposure, self.gain):
            box.editingFinished.connect(self._expose)
        return row(
            label("exposure", "name"),
            (self.exposure, 1),
            label("gain", "name"),
            (self.gain, 1),
        )
