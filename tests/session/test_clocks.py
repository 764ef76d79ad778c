"""The clock of a foreign table of forces is found as it is or not at all, in worlds that press the
block sideways, hold, unload, cut the table and never drive.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import foreign_lab as foreign
import numpy as np
import pytest

from app.files import importing
from app.files.clocks import Match, MotionInImages, clocks_of
from app.files.frames import Sources
from app.system.errors import UserError

EXPOSURE = 0.01


@dataclass(frozen=True)
class Bench:
    """An experiment: times, s, of the clock of the images; displacements, px; forces, N."""

    rate: float = 10.0  # images per second
    pressing: tuple[float, float] = (1.3, 2.2)  # when P rises
    sideways: tuple[float, float] = (2.0, -1.0)  # the motion of pressing
    creep_s: float = 0.0  # the motion of pressing goes on so long
    jump: bool = False  # it is a jump where P begins to rise
    drive: float = 5.0
    elastic: float = 0.9  # displacement up to sliding
    loading: float = 4.0  # time that takes
    held: float = np.inf  # when the stage stops
    back: float = np.inf  # when it goes back
    end: float = 16.0
    friction: float = 0.9
    cross_talk: float = 0.0
    load: float = 0.1
    noise_px: float = 5e-4
    noise_n: float = 1e-4
    force_rate: float = 500.0
    table: tuple[float, float] = (0.0, np.inf)  # of the experiment, what the forces cover
    seed: int = 1

    def travel(self, t: np.ndarray) -> np.ndarray:
        """Of the stage, as a share of that with which sliding begins."""
        t = np.asarray(t, dtype=float)
        gone = np.minimum(t, self.held) - self.drive - 2 * np.clip(t - self.back, 0, None)
        return np.clip(gone, 0, None) / self.loading

    def moved(self, t: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Displacement of the block, px, and Q/(mu P): Cattaneo and Mindlin, in series with a
        cantilever; Masing's rule for the way back.
        """
        grid = np.linspace(0, 1, 400)
        soft = 1 - (1 - grid) ** (2 / 3)
        held = 0.5 * soft + 0.5 * grid
        s = self.travel(t)
        q = np.interp(s, held, grid)
        u = np.interp(s, held, soft) * self.elastic
        u += np.clip(s - 1, 0, None) * 2 * self.elastic
        turned = np.asarray(t) > self.back
        if turned.any():
            top = float(self.travel(np.array([self.back]))[0])
            q0, u0 = np.interp(top, held, grid), np.interp(top, held, soft) * self.elastic
            u0 += max(top - 1, 0) * 2 * self.elastic
            less = (top - s[turned]) / 2
            q[turned] = q0 - 2 * np.interp(less, held, grid)
            u[turned] = u0 - 2 * np.interp(less, held, soft) * self.elastic
        return u, q

    def images(self) -> MotionInImages:
        rng = np.random.default_rng(self.seed)
        t = np.arange(0, self.end, 1 / self.rate)
        u, _ = self.moved(t + EXPOSURE / 2)
        shift = np.outer(self._pressed(t + EXPOSURE / 2), self.sideways)
        shift[:, 0] += u
        return MotionInImages(t, shift + self.noise_px * rng.normal(size=shift.shape))

    def _rising(self, t: np.ndarray) -> np.ndarray:
        begin, end = self.pressing
        share = np.clip((t - begin) / (end - begin), 0, 1)
        return share * share * (3 - 2 * share)

    def _pressed(self, t: np.ndarray) -> np.ndarray:
        begin, _ = self.pressing
        if self.jump:
            return (t > begin).astype(float)
        if self.creep_s:
            crept = 1 - np.exp(-np.clip(t - begin, 0, None) / self.creep_s)
            return 0.7 * self._rising(t) + 0.3 * crept
        return self._rising(t)

    def forces(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        rng = np.random.default_rng(self.seed + 1)
        t = np.arange(0, self.end + 6, 1 / self.force_rate)
        p = self.load * self._rising(t)
        q = self.friction * self.load * self.moved(t)[1] + self.cross_talk * p
        noise = self.noise_n * rng.normal(size=(2, len(t)))
        used = (t >= self.table[0]) & (t <= self.table[1])
        return t[used], (p + noise[0])[used], (q + noise[1])[used]

    def found(self, ahead: float) -> list[Match]:
        t, p, q = self.forces()
        return clocks_of(self.images(), t + ahead, p, q, EXPOSURE)


def within(found: list[Match], ahead: float) -> bool:
    return len(found) == 1 and abs(found[0].ahead_s - ahead) <= 3 * found[0].sd_s


PRESSING = {
    "smooth": Bench(),
    "half a pixel": Bench(sideways=(0.4, 0.3)),
    "along the drive": Bench(sideways=(3.0, 0.0)),
    "against the drive": Bench(sideways=(-3.0, 0.0)),
    "a jump": Bench(jump=True),
    "creep": Bench(creep_s=0.4),
    "P is read as Q": Bench(cross_talk=0.05),
    "no sideways motion": Bench(sideways=(0.0, 0.0)),
    "forces begin under load": Bench(table=(3.0, np.inf)),
    "forces end early": Bench(table=(0.0, 8.5)),
    "unloaded": Bench(back=9.5),
    "held": Bench(held=8.0),
    "noise": Bench(noise_px=3e-3, noise_n=5e-4, elastic=2.0),
    "loaded as fast as pressed": Bench(loading=1.0, rate=25.0),
}


@pytest.mark.parametrize("bench", PRESSING.values(), ids=PRESSING)
@pytest.mark.parametrize("ahead", [3.2, -40.0])
def test_the_motion_of_pressing_is_not_taken_for_the_drive(bench: Bench, ahead: float) -> None:
    found = bench.found(ahead)
    assert within(found, ahead)
    assert found[0].sd_s < 0.15


NOTHING = {
    "images of pressing only": Bench(end=4.5),
    "and forces under load only": Bench(end=4.5, table=(3.0, np.inf), rate=20.0, loading=2.0),
    "forces of pressing only": Bench(table=(0.0, 4.9)),
    "nothing moves": Bench(sideways=(0.0, 0.0), end=4.5),
}


@pytest.mark.parametrize("bench", NOTHING.values(), ids=NOTHING)
def test_where_no_drive_is_seen_in_both_no_clock_is_found(bench: Bench) -> None:
    assert not bench.found(3.2)


def test_two_clocks_that_are_possible_are_both_told() -> None:
    """The forces of a drive as fast as pressing was, and images that end before it."""
    bench = Bench(
        pressing=(1.56, 2.59),
        sideways=(2.1, 1.7),
        drive=5.41,
        elastic=0.74,
        loading=1.27,
        end=4.5,
        noise_px=1e-3,
        noise_n=9e-4,
        force_rate=50.0,
    )
    found = bench.found(3.2)
    assert len(found) == 2
    assert any(abs(one.ahead_s - 3.2) <= 3 * one.sd_s for one in found)


def hostile(seed: int) -> Bench:
    """A world in which about everything is drawn by lot."""
    lot = np.random.default_rng(seed)
    begin, lasts = lot.uniform(0.6, 3.0), lot.uniform(0.2, 1.5)
    drive = begin + lasts + lot.uniform(0.8, 4.0)
    loading = lot.uniform(0.6, 6.0)
    angle, size = lot.uniform(0, 2 * np.pi), lot.uniform(0.5, 4.0)
    bench = Bench(
        rate=float(lot.choice([5, 8, 10, 20])),
        pressing=(begin, begin + lasts),
        sideways=(size * np.cos(angle), size * np.sin(angle)),
        creep_s=float(lot.choice([0, 0, 0.3, 0.8])),
        jump=bool(lot.random() < 0.2),
        drive=drive,
        elastic=lot.uniform(0.3, 3.0),
        loading=loading,
        end=drive + loading * lot.uniform(1.1, 2.5),
        cross_talk=float(lot.choice([0, 0.02, 0.05, 0.1])),
        noise_px=10 ** lot.uniform(-3.5, -2.2),
        noise_n=10 ** lot.uniform(-4.3, -3.0),
        force_rate=float(lot.choice([50, 200, 1000])),
        seed=seed,
    )
    held, back = drive + loading * lot.uniform(0.3, 1.2), drive + loading * lot.uniform(0.4, 1.2)
    under_load = begin + lasts + lot.uniform(0.1, 0.5) * (drive - begin - lasts)
    changes: list[dict[str, object]] = [
        {},
        {"sideways": (0.0, 0.0)},
        {"end": begin + lasts + min(lot.uniform(0.5, 3.0), drive - begin - lasts)},
        {"table": (under_load, np.inf)},
        {"table": (0.0, drive + loading * lot.uniform(0.3, 0.9))},
        {"table": (0.0, drive - 0.1)},
        {"held": held, "end": held + 3.0},
        {"back": back, "end": back + loading * lot.uniform(0.3, 1.5)},
    ]
    return replace(bench, **changes[seed % len(changes)])


@pytest.mark.slow
def test_a_clock_is_right_within_its_uncertainty_or_not_found() -> None:
    right = 0
    for seed in range(40):
        ahead = float(np.random.default_rng(seed).uniform(-20, 20))
        found = hostile(seed).found(ahead)
        assert len(found) != 1 or within(found, ahead), (seed, found[0].ahead_s - ahead)
        right += within(found, ahead)
    assert right >= 16  # of the 30 in which both show the drive


DIFFICULT = {
    "the block creeps while Q would rise": Bench(
        rate=20.0,
        pressing=(2.848, 4.326),
        sideways=(-1.36, 1.02),
        creep_s=0.8,
        drive=5.253,
        elastic=1.509,
        loading=5.595,
        end=11.516,
        noise_px=1.43e-3,
        noise_n=1.5e-4,
        force_rate=50.0,
        table=(0.0, 8.421),
        seed=249,
    ),
    "Q is known worse than the displacement": Bench(
        rate=20.0,
        pressing=(2.756, 3.26),
        sideways=(1.18, 1.3),
        jump=True,
        drive=6.916,
        elastic=2.903,
        loading=5.067,
        held=11.849,
        cross_talk=0.05,
        noise_px=2.1e-3,
        noise_n=8.2e-4,
        force_rate=50.0,
        seed=129,
    ),
}


@pytest.mark.parametrize("bench", DIFFICULT.values(), ids=DIFFICULT)
def test_a_difficult_clock_is_right_or_not_found(bench: Bench) -> None:
    found = bench.found(3.2)
    assert len(found) != 1 or within(found, 3.2)


@pytest.fixture(scope="module", autouse=True)
def looked_once() -> Iterator[None]:
    with pytest.MonkeyPatch.context() as patch:
        foreign.look_once(patch)
        yield


@pytest.fixture(scope="module")
def pushed(tmp_path_factory: pytest.TempPathFactory) -> tuple[foreign.Lab, Path]:
    """Images of a block that pressing moves by 2.2 px, and forces whose clock is 3.2 s ahead."""
    lab = foreign.measured(foreign.Plan(shape=(240, 240), end=9.0, sideways=(-2.0, 1.0)))
    folder = tmp_path_factory.mktemp("pushed")
    foreign.write_images(lab, folder / "images")
    foreign.write_forces(lab, folder / "kraft.csv", foreign.Style(ahead=3.2))
    return lab, folder


def given(folder: Path) -> Sources:
    return Sources(
        images=[folder / "images"], forces=folder / "kraft.csv", frame_rate=8.0, pixel_um=11
    )


@pytest.mark.slow
def test_images_that_pressing_moves_get_the_clock_of_the_drive(
    pushed: tuple[foreign.Lab, Path],
) -> None:
    lab, folder = pushed
    read = importing.understood(given(folder))
    assert any("-3.200 s are added" in remark for remark in read.remarks)
    drive = next(event.sample for event in read.measured.events if event.text == "drive")
    start = read.frames[0].sample
    assert (drive - start) / read.config.forces.sample_rate == pytest.approx(lab.drive_s, abs=0.03)


def test_between_two_clocks_the_operator_decides(
    pushed: tuple[foreign.Lab, Path], monkeypatch: pytest.MonkeyPatch
) -> None:
    two = [Match(3.2, 0.03), Match(6.61, 0.05)]
    monkeypatch.setattr(importing, "clocks_of", lambda *_: two)
    with pytest.raises(UserError, match=r"3\.200 ± 0\.030 or 6\.610 .* --time-offset -3\.200 or"):
        importing.understood(given(pushed[1]))
