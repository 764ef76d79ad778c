"""What the window shows, as plain values.

Everything is decided here, without Qt; the widgets only draw. `read` takes the newest data from a
source, and `resolve` turns them into a frozen `ViewState`.
"""

from __future__ import annotations

import math
import time
from dataclasses import dataclass, fields, replace

from app.evaluation.timeline import ReplayVerdict
from app.gui import cells
from app.gui.cells import Cell, Cells, Tone
from app.gui.frame_results import (
    Circles,
    FrameResults,
    ShownImage,
    circles,
    frame_results,
    shown_image,
)
from app.gui.point_history import FieldHistory
from app.gui.run_charts import Cursor, RunCharts
from app.gui.run_curves import (
    Curves,
    extended,
    force_strips,
    middle_s,
    no_curves,
)
from app.gui.run_steps import RunSteps, run_steps
from app.gui.source import Point, Setup, as_replay
from app.records.quantities import resolved
from app.records.record_types import (
    ENDED,
    Counts,
    Outcome,
    Phase,
    Snapshot,
)
from app.records.run_view import RunView
from app.report.card import Card, card_of
from app.runs.run_source import Image, Kind, RunSource
from app.system.stopping import Stop, StopAnswer


@dataclass(frozen=True, slots=True)
class DisplayStatistics:
    """What was seen of a run: how many of its images were painted, and how long after it was read
    the newest one was.
    """

    shown: int = 0
    delay_s: float = math.nan


NOTHING_DISPLAYED = DisplayStatistics()


@dataclass(frozen=True, slots=True, eq=False)
class Reading(RunView):
    """The newest data of a source, asked for at a moment `at_s` of the computer's clock; `browsed`
    is the recorded frame that is shown in their place, `is_analysed` whether it has results,
    `is_playing` whether it changes by itself, and `agreement` what a replay comes to.
    """

    at_s: float = math.nan
    display: DisplayStatistics = NOTHING_DISPLAYED
    browsed: Snapshot | None = None
    cores: float = math.nan
    is_analysed: bool = True
    is_playing: bool = True
    agreement: ReplayVerdict | None = None
    point_px: Point | None = None  # a place whose history is asked for


@dataclass(frozen=True, slots=True, eq=False)
class ViewState:
    """All that the window shows of a run at one instant.

    Attributes
    ----------
    badge : str
        What the badge says, in the colour `tone`: the state of a run, REPLAY or ANALYSIS.
    goes_on : bool
        Whether it changes by itself.
    at_s : float
        When it was read, by the computer's clock.
    """

    state: str
    tone: Tone
    phase: str
    sentence: str
    progress: float
    counts: Cells
    queue_fill: float
    queue: Cell
    disk: Cell
    latency: Cell
    screen: Cell
    processor: Cell
    verdict: Cell
    image: ShownImage | None
    reference: ShownImage | None
    frame: FrameResults | None
    circles: Circles
    curves: Curves
    charts: RunCharts
    fields: FieldHistory
    shown: Snapshot | None
    readouts: Cells
    result: Cells
    outcome: Outcome | None
    behind: int
    steps: RunSteps
    shed: int = 0
    kind: Kind = Kind.LIVE
    badge: str = ""
    agreement: ReplayVerdict | None = None
    card: Card | None = None
    stop: StopAnswer | None = None
    goes_on: bool = False
    at_s: float = math.nan

    @property
    def ended(self) -> bool:
        """Whether the run is over."""
        return self.state in ENDED

    @property
    def place(self) -> str:
        """Where the stage of a run that has failed stands, if it was read at rest."""
        if self.state != "failed" or self.stop is None or self.stop.kind is not Stop.AT_REST:
            return ""
        return self.stop.sentence.removeprefix("STOP MOTION: the ").partition(";")[0]


def read(
    source: RunSource,
    seen: int,
    *,
    is_shown: bool = True,
    display: DisplayStatistics = NOTHING_DISPLAYED,
    cores: float = math.nan,
    point_px: Point | None = None,
) -> Reading:
    """The newest data of `source`; of the snapshots, those after the first `seen`. `is_shown` says
    whether the window can be seen, `cores` how many the program uses, and `point_px` the place
    whose history is asked for.
    """
    at_s = time.monotonic()
    view = source.look(seen, is_shown=is_shown)
    shown = {field.name: getattr(view, field.name) for field in fields(view)}
    reading = Reading(**shown, at_s=at_s, display=display, cores=cores, point_px=point_px)
    replay = as_replay(source)
    if replay is None:
        return reading
    browsed = replay.browsed()
    return replace(
        reading,
        browsed=browsed,
        is_analysed=browsed is None or replay.has_results(browsed.frame),
        is_playing=replay.is_playing,
        agreement=replay.verdict(),
    )


def waiting_frames(counts: Counts) -> int:
    """Frames that wait for their analysis."""
    return counts.frames_received - counts.frames_analysed - counts.frames_skipped


def resolve(setup: Setup, reading: Reading, previous: ViewState | None) -> ViewState:
    """Everything that the window shows after `reading`, which came after `previous`.

    Parts that did not change are the same objects. While an older frame is browsed it takes the
    place of the newest one, but for the curves and the sentence.
    """
    health, outcome, config = reading.health, reading.outcome, setup.config
    apparent_m = reading.contact.apparent_radius_m if reading.contact else math.nan
    curves = extended(
        previous.curves if previous else no_curves(setup), reading.snapshots, setup, apparent_m
    )
    shown, with_field = curves.newest, curves.newest_field
    normal_n, shear_n = (float(f[-1]) if len(f) else math.nan for f in reading.forces[1:])
    if reading.browsed is not None:
        shown = with_field = reading.browsed
        normal_n, shear_n = shown.conditions.normal_force_n, shown.conditions.shear_force_n
    travel_m = shown.conditions.travel_m if shown else math.nan
    stick = with_field.stick_radius if with_field else (math.nan, math.nan)
    full_scale = config.camera.full_scale
    image = _as_shown(reading.image, previous.image if previous else None, full_scale)
    before = previous.reference if previous else None
    reference = _as_shown(reading.reference, before, full_scale)
    around = circles(reading.contact, resolved(*stick), normal_n, setup)
    last = frame = previous.frame if previous else None
    if with_field is None:
        frame = None
    elif last is None or last.frame != with_field.frame:
        frame = frame_results(with_field, setup, around)
        if last and frame:
            frame.prepare(last)
    newest = curves.newest
    behind_s = (health.sample - newest.sample) / config.forces.sample_rate if newest else math.nan
    latency = cells.latency_cell(math.nan if outcome else behind_s)
    delay_s = health.image_age_s + reading.display.delay_s
    screen = cells.screen_cell(math.nan if outcome else delay_s)
    if previous is not None and image is previous.image and not outcome:
        screen = previous.screen  # the image was seen before
    # a run that has ended since its outcome was read is told with the next reading
    state = "stopping" if health.state in ENDED else health.state
    if outcome is not None:
        state = outcome.ended_as
    if setup.timeline is None:
        sentence = cells.operator_sentence(health, outcome, normal_n, travel_m, config)
    else:
        sentence = recorded_sentence(setup, reading, shown)
    queue, disk = cells.queue_cell(health), cells.disk_cell(health, config)
    badge, tone = badge_of(setup.kind, state, is_paused=not reading.is_playing)
    forces = force_strips(reading.forces, curves.drive_start_s, setup)
    summary = outcome.summary if outcome else None
    fields, seen = previous.fields if previous else FieldHistory(), curves.newest_field
    fields = fields.with_frame(seen, middle_s(seen, setup) if seen else math.nan, setup)
    point = fields.chart(reading.point_px, curves.drive_start_s, setup)
    charts = RunCharts(setup, curves, frame, forces, summary, point, _cursor(setup, shown))
    if previous is not None:
        charts.prepare(previous.charts)
    return ViewState(
        state=state,
        tone=tone,
        phase=str(Phase.END) if outcome else health.phase,
        sentence=cells.typeset(sentence),
        progress=min(1.0, max(0.0, health.progress)),
        counts=cells.count_cells(health, reading.display.shown),
        queue_fill=min(1.0, max(0.0, health.queue_fill)),
        queue=queue,
        disk=disk,
        latency=latency,
        screen=screen,
        processor=cells.processor_cell(reading.cores),
        verdict=cells.verdict_cell(health, outcome, queue, disk),
        image=image,
        reference=reference,
        frame=frame,
        circles=around,
        curves=curves,
        charts=charts,
        fields=fields,
        shown=shown,
        readouts=cells.readouts(normal_n, shear_n, travel_m, *stick),
        result=previous.result if previous else cells.setting_cells(config),
        outcome=outcome,
        behind=waiting_frames(health.counts) if setup.kind is Kind.LIVE else 0,
        steps=run_steps(
            config,
            health,
            outcome,
            newest.conditions if newest else None,
            (normal_n, shear_n),
            previous.steps if previous else None,
        ),
        shed=health.shed,
        stop=reading.stop,
        kind=setup.kind,
        badge=badge,
        agreement=reading.agreement,
        card=_card(setup, reading, previous),
        goes_on=reading.is_playing and outcome is None,
        at_s=reading.at_s,
    )


def _as_shown(taken: Image | None, before: ShownImage | None, full_scale: int) -> ShownImage | None:
    """An image as displayed; that of `before`, where none was taken since."""
    if taken is None or (before is not None and before.full is taken):
        return before
    return shown_image(taken, full_scale)


def _card(setup: Setup, reading: Reading, previous: ViewState | None) -> Card | None:
    """The result card, once the run has ended."""
    if reading.outcome is None:
        return None
    if previous is not None and previous.outcome is reading.outcome:
        return previous.card
    uncertain, is_live = reading.health.uncertain, setup.kind is Kind.LIVE
    return card_of(setup.title, reading.outcome, uncertain, is_live=is_live)


def badge_of(kind: Kind, state: str, *, is_paused: bool) -> tuple[str, Tone]:
    """What the badge says, and its colour: no replay looks like a run."""
    if kind is Kind.LIVE:
        return state.upper(), cells.tone_of(state)
    now = state if state in ("done", "failed", "stopped") else "paused" if is_paused else ""
    tone = Tone.BAD if state == "failed" else Tone.REPLAY
    return ": ".join(filter(None, (kind, now))).upper(), tone


def recorded_sentence(setup: Setup, reading: Reading, shown: Snapshot | None) -> str:
    """One sentence about the frame of a recorded run that is shown or, at the end of a replay, why
    it ended and whether it agrees.
    """
    outcome, line, config = reading.outcome, setup.timeline, setup.config
    is_at_end = outcome is not None and reading.browsed is None
    if is_at_end or shown is None or line is None:
        reason = outcome.reason if outcome else reading.health.reason
        if reason and reading.agreement is not None:
            reason = f"{reason}; {reading.agreement.sentences[0]}"
        return cells.as_sentence(reason)
    time_s = line.time_s(line.middle_of(shown.frame))
    when = f"At t = {cells.number(time_s, 2)} s of the recording"
    did = cells.past_sentence(shown.conditions, config, line.step_at(shown.sample))
    note = "" if reading.is_analysed else " (This frame was not analysed during the run.)"
    return f"{when} {did}{note}"


def _cursor(setup: Setup, shown: Snapshot | None) -> Cursor | None:
    """Where the frame of a recorded run that is shown is on the curves."""
    if setup.timeline is None or shown is None:
        return None
    now, middle = shown.conditions, setup.timeline.middle_of(shown.frame)
    return Cursor(
        shown.frame,
        setup.timeline.time_s(middle),
        now.travel_m * 1e6,
        now.shear_force_n,
    )
