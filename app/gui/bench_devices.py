"""The devices of a bench: the state of each, and which driver it has."""

from __future__ import annotations

import logging
from functools import partial
from pathlib import Path

from PySide6.QtWidgets import QWidget

from app.gui.background import BackgroundWork, Take
from app.gui.bench_cells import MARKS, NATURES, SOURCES, DeviceLine, device_lines
from app.gui.cells import Tone
from app.gui.file_question import SESSION_FILES, ask_file
from app.gui.form import Form
from app.gui.widgets import STRETCH, Choice, column, label, row, tint, write
from app.gui.window_model import WindowModel
from app.records.bench_view import BenchView
from app.settings.config import ConfigError, sources
from app.settings.sections import Config

LOG = logging.getLogger(__name__)
REPLAY = "replay"
Natures = dict[str, str]  # of the drivers of a device, by their names


class DeviceLineView(QWidget):
    """A device with its state and its sentence; until it is connected, the choice of its driver."""

    def __init__(self, name: str) -> None:
        super().__init__()
        self.mark = label("", "heading")
        self.sentence = label("", "muted", is_cut=True)  # a fault's is told below the buttons, too
        self.source = Choice(
            accessibleName=f"Driver: {name}",
            toolTip="Which driver the device has: real, emulated, simulated or replayed",
        )
        self.device, self.word = label("", "", is_cut=True), label("", "detail")
        self.mark.setFixedWidth(16)
        self._shown: DeviceLine | None = None
        self._known: Natures = {}
        head = row(self.mark, (self.device, 1), (self.source, 2), self.word, spacing=4)
        self.setLayout(column(head, self.sentence, STRETCH, spacing=0))
        # connecting moves no button that is below: the driver has the room of the sentence
        self.setFixedHeight(2 * self.fontMetrics().lineSpacing() + 4)

    def offer(self, sources: Natures, source: str) -> None:
        """Offer drivers, given by their natures; `source` is chosen."""
        known = sources if source in sources else sources | {source: ""}
        if known != self._known:
            self._known = known
            self.source.clear()
            for name, nature in known.items():
                self.source.add(SOURCES.get(name, name), name, NATURES[nature])
        self.source.setCurrentIndex(self.source.findData(source))

    def show_line(self, line: DeviceLine) -> None:
        """Show it, unless it is shown already."""
        if line == self._shown:
            return
        self._shown = line
        self.mark.setText(MARKS[line.tone])
        tint(self.mark, line.tone)
        write(self.device, line.name)
        self.word.setText(line.word)
        is_wrong = line.tone in (Tone.WARN, Tone.BAD)
        for text in (self.word, self.sentence):
            tint(text, line.tone if is_wrong else None)
        write(self.sentence, line.sentence)
        self.sentence.setVisible(bool(line.sentence))


class DeviceList(QWidget):
    """The devices one below the other.

    Parameters
    ----------
    model : WindowModel
        Its settings have the drivers.
    refuse : callable
        Is told why a driver cannot be used.
    """

    def __init__(self, model: WindowModel, refuse: Take) -> None:
        super().__init__()
        self._model, self._refuse, self._background = model, refuse, BackgroundWork(self)
        self.lines = {line.kind: DeviceLineView(line.name) for line in device_lines(None)}
        self._sources: dict[str, Natures] = {kind: {} for kind in self.lines}
        for kind, one in self.lines.items():
            one.source.activated.connect(partial(self._choose, kind))
        self.setLayout(column(*self.lines.values()))
        self._background.start(sources, self._offer, LOG.warning)
        model.settings_changed.connect(self._show_sources)
        self._show_sources()

    def show_devices(self, view: BenchView | None, *, can_choose: bool) -> None:
        """Show the devices of a connected bench, or else which will be connected."""
        for line in device_lines(view):
            one = self.lines[line.kind]
            one.show_line(line)
            one.source.setVisible(view is None)
            one.source.setEnabled(can_choose)

    def _offer(self, found: dict[str, Natures]) -> None:
        self._sources = found
        self._show_sources()

    def _show_sources(self) -> None:
        for kind, one in self.lines.items():
            one.offer(self._sources[kind], getattr(self._model.config, kind).source)

    def _choose(self, kind: str, index: int) -> None:
        """Let a device have another driver; a recorded session is asked for unless another device
        plays one already.
        """
        source = self.lines[kind].source.itemData(index)
        if source == REPLAY and REPLAY not in self._model.config.sources:
            self._show_sources()  # until a session is chosen
            put = partial(self._put, kind, source)
            ask_file(self, "Session to be replayed", put, kinds=SESSION_FILES)
        else:
            self._put(kind, source)

    def _put(self, kind: str, source: str, session: Path | None = None) -> None:
        before, key = self._model.config, f"{kind}.source"
        form = Form(before)

        def put() -> Config:  # which imports the driver
            if session is not None:
                form.put("replay.session", str(session))
            if not form.put(key, source):
                raise ConfigError(form.refused[key].sentence)
            return form.config

        def take(config: Config) -> None:
            if self._model.config == before:
                self._model.set_config(config)
            else:  # what was changed meanwhile holds
                self._put(kind, source, session)

        def failed(why: str) -> None:
            self._refuse(why)
            self._show_sources()

        self._background.start_anew(put, take, failed)
