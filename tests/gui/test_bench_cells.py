"""What the bench panel says, and its way to the bench, without Qt."""

import math
import random
import threading
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scripted_run import ScriptedRun

from app.gui.bench_cells import (
    device_lines,
    disk_text,
    gauges,
    goal_text,
    is_outdated,
    jog_speeds,
    picture_cells,
    room_text,
    stage_text,
    task_text,
    zeroed_text,
)
from app.gui.bench_link import (
    BenchLink,
    BenchMessage,
    LinkState,
    SingleTask,
    ZeroedForces,
    nearest,
)
from app.gui.cells import Tone, readouts, setting_cells
from app.gui.frame_results import KINDS, FieldImage
from app.gui.image_view import describe_point
from app.gui.source import setup_of
from app.records.bench_view import (
    BenchView,
    DeviceState,
    DeviceView,
    ForcesView,
    PictureView,
    StageTask,
    StageView,
)
from app.settings.config import load
from app.system.disk import bytes_text

CONFIG = load(None, ["run.normal_force=0.5", "limits.normal_force=1.9", "limits.shear_force=1.5"])


def forces(
    normal: float,
    shear: float = 0.0,
    noise: float = 1e-3,
    used: float = 0.3,
    age_s: float = 0.0,
) -> ForcesView:
    history = np.array([[normal, shear]] * 3)
    return ForcesView(
        (normal, shear), (noise, noise), (used, 0.1), np.array([-0.2, -0.1, 0.0]), history, age_s
    )


@pytest.mark.parametrize(
    ("seen", "tone", "note"),
    [
        (forces(0.5), Tone.GOOD, "in its band, noise 1.0 mN"),
        (forces(0.509), Tone.GOOD, "in its band, noise 1.0 mN"),
        (forces(0.511), Tone.NEUTRAL, "noise 1.0 mN"),
        (forces(0.5, noise=math.nan), Tone.GOOD, "in its band"),
        (forces(0.5, noise=0.119), Tone.WARN, "noise 119.0 mN: too much"),
        (forces(1.75), Tone.WARN, "near its limit of 1.9 N"),
        (forces(1.95), Tone.BAD, "beyond its limit of 1.9 N"),
        (forces(1.0, used=0.99), Tone.BAD, "sensor at the end of its range"),
        (forces(0.5, age_s=3.2), Tone.BAD, "no reading for 3 s"),
    ],
)
def test_the_gauge_of_p_says_what_is_wrong(seen: ForcesView, tone: Tone, note: str) -> None:
    gauge = gauges(seen, CONFIG)[0]
    assert (gauge.tone, gauge.text) == (tone, note)
    assert gauge.band == pytest.approx((0.49, 0.51))
    assert gauge.limits == (1.9,)


def test_the_gauge_of_q_has_both_limits_and_the_band_in_which_a_run_begins() -> None:
    gauge = gauges(forces(0.5, shear=-1.6), CONFIG)[1]
    assert (gauge.text, gauge.tone) == ("beyond its limit of 1.5 N", Tone.BAD)
    assert gauge.limits == (-1.5, 1.5)
    assert gauge.band == pytest.approx((-0.005, 0.005))
    assert readouts(0.5, -0.0002, *3 * (math.nan,))[1].value == "0.000"


def test_the_band_is_that_of_the_first_load_of_the_steps() -> None:
    gauge = gauges(None, load(Path("cyclic-shear")))[0]
    assert gauge.band == pytest.approx((0.294, 0.306))
    assert gauge.text == "–"


def test_no_number_with_few_digits_has_an_exponent() -> None:
    wide = replace(CONFIG, run=replace(CONFIG.run, shear_tolerance=0.3))
    assert gauges(None, wide)[1].legend == "± 150 mN · limit ± 1.5 N"
    fast = load(
        None,
        [
            "camera.divisor=1",
            "camera.exposure=0.5",
            "forces.sample_rate=1234",
            "camera.max_rate=2000",
        ],
    )
    assert setting_cells(fast)[3].value == "1230"
    steps = (
        '{do="approach", normal_force=0.1}, {do="reference"}, {do="drive", travel=60, velocity=2}'
    )
    of_steps = [
        (cell.name, cell.value) for cell in setting_cells(load(None, [f"run.steps=[{steps}]"]))
    ]
    assert of_steps[:3] == [("normal force P", "0.1"), ("velocity", "2"), ("travel", "60")]
    assert bytes_text(999_700_000_000) == "1000 GB"
    setup = setup_of(ScriptedRun(320, 240, frames=4))
    values = np.full((23, 31), 1234.5, np.float32)
    field = FieldImage(KINDS["sigma_kPa"], values, "")
    assert describe_point(setup, field, 160, 120).endswith("σₓz 1230 kPa")


def test_each_state_of_a_device_has_a_word_a_mark_and_its_sentence() -> None:
    states = dict(zip(("actuator", "camera", "forces"), DeviceState, strict=False))
    devices = {kind: DeviceView("SMC100", state, "umbra of 5 um") for kind, state in states.items()}
    view = BenchView(devices, None, None, None, 0.0, "")
    lines = {line.kind: line for line in device_lines(view)}
    assert lines["forces"].word == "look at it"
    assert lines["forces"].tone is Tone.WARN
    assert lines["actuator"].name == "Stage: SMC100"
    assert {line.sentence for line in lines.values()} == {"umbra of 5 µm"}
    assert {line.word for line in device_lines(None)} == {"not connected"}


@pytest.mark.parametrize(
    ("minutes", "text", "tone"),
    [
        (3, "3 min of recording", Tone.BAD),
        (20, "20 min of recording", Tone.WARN),
        (90, "90 min of recording", Tone.NEUTRAL),
        (1200, "20 h of recording", Tone.NEUTRAL),
    ],
)
def test_the_disk_is_told_in_minutes(minutes: int, text: str, tone: Tone) -> None:
    found, colour = disk_text(1e7, round(minutes * 60 * 1e7))
    assert found.startswith(text)
    assert colour is tone
    assert disk_text(1e7, 400_000_000)[0] == "1 min of recording, 400 MB free"
    assert disk_text(math.nan, 10**12)[0] == "–"
    assert disk_text(1e7, -1)[0] == "–"


def test_the_stage_is_told_with_its_room() -> None:
    stage = StageView(12.5e-3, True, 12.3e-3, 13.0e-3)
    assert stage_text(stage) == ("12.5000 mm, moving", Tone.BUSY)
    assert room_text(stage) == "can be jogged by −200 to +500 µm"
    assert goal_text(stage) == f"{room_text(stage)}, sent to 12.3000 to 13.0000 mm"
    sent = replace(stage, task=StageTask.MOVE, goal_m=12.7e-3)
    assert goal_text(sent) == "goes to 12.7000 mm; STOP MOTION (Esc) stops it"
    home = replace(stage, task=StageTask.HOME)
    assert goal_text(home).startswith("searches its origin")
    assert [task_text(one) for one in (stage, sent, home)] == ["moving", "moving", "homing"]
    jogged = replace(stage, task=StageTask.JOG, is_moving=False)
    assert (task_text(jogged), task_text(replace(stage, is_moving=False))) == ("jogging", "")


def test_a_wrong_exposure_is_coloured() -> None:
    blank = np.zeros((2, 2, 3), np.uint8)
    good = PictureView(0, blank, np.ones(4) / 4, 0.001, 0.0, 0.4, 12.345, 0)
    assert {cell.tone for cell in picture_cells(good)} == {Tone.NEUTRAL}
    assert [cell.value for cell in picture_cells(good)] == ["40%", "0.10%", "12.35"]
    bright = replace(good, saturated=0.05, mean=0.95)
    assert [cell.tone for cell in picture_cells(bright)][:2] == [Tone.WARN, Tone.WARN]


def test_a_zero_in_contact_is_doubted_and_a_step_zero_is_named() -> None:
    text, tone = zeroed_text(ZeroedForces((0.01, 0.002), (0.003, 0.0)), CONFIG)
    assert tone is Tone.GOOD
    assert "+0.0100 V" in text
    text, tone = zeroed_text(ZeroedForces((0.01, 0.002), (0.4, 0.0)), CONFIG)
    assert tone is Tone.WARN
    assert "lift it and zero again" in text
    steps = 'run.steps=[{do="zero"}, {do="approach"}, {do="reference"}, {do="drive", travel=50}]'
    text, _ = zeroed_text(ZeroedForces((0.01, 0.002), (0.0, 0.0)), load(None, [steps]))
    assert "Its step 1 zeroes once more." in text


def test_a_zero_is_no_other_bench() -> None:
    zeroed = replace(CONFIG, forces=replace(CONFIG.forces, zero=(0.1, 0.2)))
    assert not is_outdated(CONFIG, zeroed)
    assert is_outdated(CONFIG, replace(CONFIG, camera=replace(CONFIG.camera, gain=3.0)))


def test_the_fast_jog_obeys_the_limit_of_the_stage() -> None:
    assert jog_speeds(CONFIG) == pytest.approx((10e-6, 100e-6))
    slow = load(None, ["actuator.max_velocity=40"])
    assert jog_speeds(slow) == pytest.approx((4e-6, 40e-6))


# ---------------------------------------------------------------------- the way to the bench


def until(is_so: Callable[[], bool]) -> None:
    give_up = time.monotonic() + 60
    while not is_so():
        assert time.monotonic() < give_up
        time.sleep(0.001)


def reach(link: BenchLink, phase: LinkState) -> None:
    until(lambda: link.phase is phase and not link._life.busy_s)


class Preview:
    """A bench that counts how often it was opened and closed."""

    open_now: list["Preview"] = []  # noqa: RUF012 - of all

    def __init__(self, config: Any) -> None:
        time.sleep(random.uniform(0, 0.004))
        self.config = config
        self.open_now.append(self)

    def look(self, known: int) -> BenchView:
        time.sleep(random.uniform(0, 0.002))
        return BenchView({}, None, None, None, 0.0, "")

    def close(self) -> None:
        time.sleep(random.uniform(0, 0.004))
        self.open_now.remove(self)


def connected(kind: type[Preview]) -> BenchLink:
    """A link to a bench of a kind that is connected."""
    link = BenchLink(kind)
    link.connect(CONFIG)
    reach(link, LinkState.ON)
    return link


def leave(link: BenchLink) -> None:
    """Disconnect, and wait for that."""
    link.disconnect()
    reach(link, LinkState.OFF)


def test_the_connection_ends_as_it_was_wanted_last_whatever_came_before() -> None:
    random.seed(5)
    link = BenchLink(Preview)
    for _ in range(40):
        wanted: Any = None
        for _ in range(random.randint(1, 5)):
            wanted = random.choice([None, object(), object()])
            if wanted is None:
                link.disconnect()
            else:
                link.connect(wanted)
            time.sleep(random.uniform(0, 0.006))

        def is_as_wanted(wanted: Any = wanted) -> bool:
            link.look(Path())
            assert len(Preview.open_now) <= 1
            is_open = [p.config for p in Preview.open_now] == ([wanted] if wanted else [])
            return is_open and link.phase is (LinkState.ON if wanted else LinkState.OFF)

        until(is_as_wanted)
    link.disconnect()


def test_one_errand_at_a_time() -> None:
    done: list[int] = []
    release, errand = threading.Event(), SingleTask("test")
    assert errand.ask(lambda: (release.wait(), done.append(1)))  # type: ignore[func-returns-value]
    assert not errand.ask(lambda: done.append(2))
    assert errand.busy_s >= 0
    release.set()
    until(lambda: not errand.busy_s)
    assert done == [1]


def test_an_order_that_fails_is_told() -> None:
    link = connected(Preview)
    link.hold(1, 1e-5)  # this bench has no jog
    news: list[Any] = []
    until(lambda: bool(news.extend(link.news()) or news))
    assert isinstance(news[0], BenchMessage)
    assert "jog" in news[0].sentence
    leave(link)


def test_no_stop_is_left_out_because_another_is_under_way() -> None:
    stops: list[float] = []
    release = threading.Event()

    class Slow(Preview):
        def let_go(self) -> str:
            stops.append(time.monotonic())
            release.wait()
            return "stopped"

    link = connected(Slow)
    link.let_go()
    link.let_go()
    until(lambda: len(stops) == 2)
    release.set()
    leave(link)


def test_a_look_that_ends_once_its_bench_is_left_shows_nothing() -> None:
    class Left(Preview):
        def look(self, known: int) -> BenchView:
            leave(link)
            return super().look(known)

    link = connected(Left)
    link.look(Path())
    reach(link, LinkState.OFF)
    until(lambda: not link._look.busy_s)
    assert link.view is None


def test_the_disk_is_that_of_the_nearest_folder_there_is(tmp_path: Path) -> None:
    assert nearest(tmp_path / "evening" / "first") == tmp_path
    assert nearest(Path()) == Path.cwd()
