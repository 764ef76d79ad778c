"""A run made of closed forms: Cattaneo and Mindlin's contact, pulled through a spring.

It has neither devices nor threads.
"""

from __future__ import annotations

import math
import threading
from dataclasses import replace
from typing import Any

import numpy as np

from app.records.bench_view import Health
from app.records.record_types import (
    Conditions,
    ContactResult,
    Counts,
    DisplacementField,
    End,
    FrameMotion,
    Outcome,
    Phase,
    RingProfile,
    Snapshot,
    Stick,
    StressProfile,
    Traction,
)
from app.records.run_view import FORCE_POINTS, RunView
from app.records.snapshot_numbers import series_of
from app.records.summary import Summary
from app.settings.sections import Config
from app.system.stopping import StopAnswer, at_rest, sent_to

MU, P, STIFFNESS = 0.93, 0.5, 5000.0
HERTZ_M = float(np.cbrt(0.75 * P * 128.8e-3 * 0.75 / 3.43e6))
BACKGROUND, REFERENCE = 8, 24  # frame at which each phase ends
PERIOD = 125


class ScriptedRun:
    """A run that has gone as far as `at` says."""

    stays = False

    def __init__(
        self,
        width: int = 1600,
        height: int = 1200,
        frames: int = 330,
        title: str = "simulated bench",
    ) -> None:
        self.config = Config()
        self.title = title
        self.pixel_m = 7.04e-6
        self.sample_rate_hz = 1000.0
        self.grid_x_px = np.arange(10.0, width - 10, 10)
        self.grid_y_px = np.arange(10.0, height - 10, 10)
        self.frames, self.frame = frames, 0
        self.radius_m, self.centre_px = 2.25e-3 * width / 1600, (width * 0.51, height * 0.48)
        self.started = self.stopped = False
        self.calls: list[str] = []
        self.called = threading.Event()
        self.reason = ""
        rng = np.random.default_rng(1)
        y, x = np.mgrid[:height, :width].astype(np.float32)
        self._r = np.hypot(x - self.centre_px[0], y - self.centre_px[1]) * np.float32(self.pixel_m)
        speckle = rng.normal(size=(height, width)).astype(np.float32)
        light = 70 - 20 * ((x - width / 2) / width) ** 2 * 4
        bright = (
            (rng.random((height, width)) > 0.93)
            * np.sqrt(np.clip(1 - (self._r / self.radius_m) ** 2, 0, 1))
            * 110
        )
        self.free = np.clip(light + 14 * speckle, 0, 255).astype(np.uint8)
        self.pressed = np.clip(light + 14 * speckle + bright, 0, 255).astype(np.uint8)
        self.reference = self.pressed.copy()
        self._snapshots = [self._snapshot(n) for n in range(frames)]

    def at(self, frame: int) -> ScriptedRun:
        self.frame = frame
        return self

    def _snapshot(self, n: int) -> Snapshot:
        phase = (
            Phase.BACKGROUND
            if n < BACKGROUND
            else Phase.CONTACT
            if n < REFERENCE - 4
            else Phase.REFERENCE
        )
        phase = Phase.DRIVE if n >= REFERENCE else phase
        sample, t = n * PERIOD, (n - REFERENCE) * PERIOD / 1000
        travel = max(0.0, t) * 4.85e-6
        shear = MU * P * min(1.0, 1 - (1 - min(1.0, travel * STIFFNESS / (MU * P) / 1.6)) ** 1.6)
        c = self.radius_m * (1 - shear / (MU * P)) ** (1 / 3)
        time_s = (sample + 5 - REFERENCE * PERIOD) / 1000 if n >= REFERENCE else math.nan
        normal = 0.0 if n < BACKGROUND else P
        snapshot = Snapshot(n, sample, Conditions(phase, time_s, normal, shear, travel))
        if n >= REFERENCE:
            r = self._r[10:-10:10, 10:-10:10][: len(self.grid_y_px), : len(self.grid_x_px)]
            shift = travel - shear / 9579
            ux = (
                shift * (1 - np.exp(-((np.clip(r - c, 0, None) / 1.2e-3) ** 1.2))) + 0.68e-6 * shear
            ) / self.pixel_m
            ux = (ux + np.random.default_rng(n).normal(0, 0.033, r.shape)).astype(np.float32)
            ux[::17, ::13] = np.nan
            same, rings = np.full_like(ux, 0.03), np.linspace(0, 3e-3, 30)
            snapshot = replace(
                snapshot,
                motion=FrameMotion(0.68e-6 * shear, 0.0),
                field=DisplacementField(ux, *[same] * 4, np.zeros(ux.shape, np.uint8)),
                rings=RingProfile(rings, rings * 0, rings * 0),
            )
        if n > REFERENCE + 8 and c > 0.05 * self.radius_m:
            return self._sheared(snapshot, c)
        return snapshot

    def _sheared(self, snapshot: Snapshot, c: float) -> Snapshot:
        """Cattaneo and Mindlin's traction for c, 30 kPa at the centre in full slip, plus 2 kPa."""
        radii = np.linspace(0, 3e-3, 61)

        def hertz_like(r: float) -> Any:
            return np.sqrt(np.clip(1 - (radii / r) ** 2, 0, None))

        sigma = 30e3 * (hertz_like(HERTZ_M) - c / HERTZ_M * hertz_like(c))
        return replace(
            snapshot,
            stick=Stick(c, 3e-5 + 1e-6 * (self.radius_m / c) ** 3, 30e3),
            traction=Traction(c + 5e-5, 2e-5, math.nan, math.nan, 0.4, 0.002),
            stress=StressProfile(radii, sigma + 2e3, np.full(61, 500.0)),
            stress_field_pa=np.full(snapshot.field.ux_px.shape, 12e3, np.float32),
        )

    def start(self) -> None:
        if self.started:
            raise RuntimeError("run: start was asked, but the run is running; make a new run")
        self.started = True

    def stop_motion(self) -> StopAnswer:
        self.calls.append("stop_motion")
        self.stopped, self.reason = True, "STOP MOTION was pressed"
        self.called.set()
        return sent_to("stage X")

    def stop_answer(self) -> StopAnswer | None:
        return at_rest("stage X", 12.5e-3) if self.stopped else None

    def request_stop(self, reason: str) -> None:
        self.calls.append(reason)
        self.stopped, self.reason = True, reason
        self.called.set()

    def health(self) -> Health:
        n = self.frame
        counts = Counts(n, n, max(0, n - 1), 0, max(0, n - 3), 2 if n > 4 else 0, n * PERIOD, 0)
        state = "idle" if not self.started else "done" if self.outcome() else "running"
        phase = (
            str(self._snapshots[min(n, self.frames - 1)].conditions.phase) if self.started else ""
        )
        return Health(
            state,
            self.reason,
            phase,
            counts,
            0.06,
            4.0,
            182_000_000_000,
            n * PERIOD,
            n / self.frames,
        )

    def latest_image(self) -> np.ndarray | None:
        return (
            None if not self.frame else self.free if self.frame < BACKGROUND + 4 else self.pressed
        )

    def reference_image(self) -> np.ndarray | None:
        return self.reference if self.frame >= REFERENCE - 4 else None

    def snapshots_since(self, n: int, *, is_shown: bool = False) -> list[Snapshot]:
        return self._snapshots[n : self.frame]

    def contact(self) -> ContactResult | None:
        if self.frame <= REFERENCE:
            return None
        return ContactResult(
            self.centre_px, self.radius_m, 3e-5, (0.0, 0.0), np.empty(0), np.empty(0)
        )

    def force_history(self, n: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        samples = np.arange(0, self.frame * PERIOD, 50)[-n:]
        at = np.minimum(samples / PERIOD, self.frames - 1)
        frames = np.arange(self.frames)
        noise = np.random.default_rng(2).normal(0, 2e-4, (2, len(samples)))
        normal = P * np.clip((samples - 1250) / 500, 0, 1)
        shear = np.interp(at, frames, series_of(self._snapshots, "shear_force_n"))
        return samples, normal + noise[0], shear + noise[1]

    def look(self, seen: int = -1, *, is_shown: bool = False) -> RunView:
        now = self.health(), self.outcome(), self.stop_answer()
        if seen < 0:
            return RunView(*now)
        return RunView(
            *now,
            tuple(self.snapshots_since(seen, is_shown=is_shown)),
            self.contact(),
            self.force_history(FORCE_POINTS),
            self.latest_image(),
            self.reference_image(),
        )

    def outcome(self) -> Outcome | None:
        if not self.stopped and self.frame < self.frames:
            return None
        summary = Summary(
            P,
            self.radius_m,
            3e-5,
            self.radius_m * 0.98,
            20.43,
            0.12,
            0.4638,
            0.9276,
            0.0021,
            0.9301,
            (0.926, 0.934),
            4.85e-6,
        )
        complete = self.frame >= self.frames
        return Outcome(
            End.STOPPED if self.reason else End.COMPLETE,
            self.reason or "the drive of 190 um is complete",
            Counts(),
            summary if complete else None,
        )
