"""The simulated world: a rough elastomer block on a cantilever, pressed on a lens and driven by a
stage, on the sample clock.

Physics: a smooth or rough contact under one of three laws of friction (`drivers.sim.contact`), in
series with the tangential cantilever and the lens holder, at constant normal force, driven along
one line, forth and, under the elasto-plastic law, back; the stage and the image may drift.
Everything follows from the scenario, its seed and the samples on which commands came. Neither the
wall clock nor the block size has any influence.
"""

from __future__ import annotations

import bisect
import math
import threading
import time
from functools import lru_cache, partial

import numpy as np

from analysis.arrays import F64, I64
from analysis.mechanics import hertz
from analysis.mechanics.tabulated_pressure import TabulatedPressure
from drivers.clock import Phased
from drivers.errors import DeviceFault, OutOfLimits
from drivers.protocols import SampleBlock, TriggerTrain
from drivers.sim.adhering_contact import adhering_faces
from drivers.sim.aged_contact import Rest
from drivers.sim.conditioner import Conditioner, unit_noise
from drivers.sim.contact import rough_faces, sheared_contact, tabulated_faces
from drivers.sim.faults import Fault, Faults
from drivers.sim.optics import Lens
from drivers.sim.scenario import ADC_BITS, PRESS_SHIFT_PX, Scenario
from drivers.sim.sheared import FRESH, Past
from drivers.sim.spindle import SpindleMove
from drivers.sim.truth import TrueState, Truth

FRAMES_AHEAD = 4  # exposed but not yet read, when the world runs as fast as it is read
HUM_HZ = 50.0


class World(Phased):
    """One simulated bench, seen by the simulated devices; its time passes only when its forces are
    read.

    Parameters
    ----------
    scenario : Scenario
    pace : float or None
        Simulated seconds per second of the wall clock; None: as fast as the forces and the frames
        of a started camera are read.
    """

    def __init__(self, scenario: Scenario, pace: float | None = 1.0) -> None:
        if pace is not None and not (pace > 0 and math.isfinite(pace)):
            raise ValueError(
                f"simulated world: a pace of {pace} was requested; give a number above 0, or None"
                " for as fast as possible"
            )
        super().__init__()
        self.scenario = scenario
        self.pace = pace
        self.now = 0
        self.faults = Faults(scenario.faults)
        self.pulses: TriggerTrain | None = None  # that the board sends to the camera
        # samples on which the exposures of the pulses counted so far began
        self.begun: list[int] = []
        self._pulses_counted = 0
        self._moves = [SpindleMove(0, 0.0, 0.0, 0.0, 0.0)]
        self._target_m = 0.0
        self._wall = min(
            (f for f in scenario.faults if f.kind in ("stall", "end-of-run")),
            key=lambda f: f.at,
            default=None,
        )
        self._way = 1.0
        self._turns: list[tuple[int, float]] = []  # sample and driven distance
        self._rests: list[tuple[int, Rest]] = []  # sample on which each ended
        self._began = 0.0
        self._train: TriggerTrain | None = None
        self._frames_read = 0
        rate, sim = scenario.forces.sample_rate, scenario.sim
        self._conditioner = Conditioner(sim.sensor_delay * rate, sim.sensor_filter * rate)
        self._contact = sheared_contact(scenario)
        self._rough = lru_cache(maxsize=4)(
            partial(rough_faces, scenario, tabulated_faces(scenario))
        )

    # ------------------------------------------------------------------ time

    def start(self, pulses: TriggerTrain | None = None) -> None:
        """Begin with sample 0 and these pulses to the camera; a world runs only once."""
        with self._changed:
            if self.phase != "idle":
                raise DeviceFault(
                    "simulated world: it has run already and can run only once; make a new bench"
                    " for another run"
                )
            self.phase, self.pulses, self._began = "running", pulses, time.monotonic()
            self._changed.notify_all()

    def wait_for_turn(self, n: int, timeout_s: float) -> bool:
        """Whether the pace and the camera allow the next `n` samples to pass within `timeout_s`
        seconds of the wall clock.
        """
        give_up = time.monotonic() + timeout_s
        with self._changed:
            while self.phase == "running":
                wait, left = self._wait_s(n), give_up - time.monotonic()
                if wait <= 0 or left <= 0:
                    return wait <= 0
                self._changed.wait(min(wait, left, threading.TIMEOUT_MAX))
        return False

    def _wait_s(self, n: int) -> float:
        end = self.now + n
        if self.pace is not None:
            due_s = end / (self.scenario.forces.sample_rate * self.pace)
            return self._began + due_s - time.monotonic()
        some_unread = self._exposed(self.now) > self._frames_read
        are_too_many = self._exposed(end) > self._frames_read + FRAMES_AHEAD
        return math.inf if some_unread and are_too_many else 0.0

    def _exposed(self, sample: int) -> int:
        if self._train is None:
            return 0
        return self._train.count_before(sample - self.scenario.frame_samples + 1)

    def watch(self, train: TriggerTrain | None) -> None:
        """Note that a camera waits for these triggers from now on; None: for none any longer."""
        with self._changed:
            self._train, self._frames_read = train, 0
            self._changed.notify_all()

    def frame_was_read(self) -> None:
        """Note that the camera has delivered its oldest frame."""
        with self._changed:
            self._frames_read += 1
            self._changed.notify_all()

    def advance(self, n: int) -> SampleBlock:
        """Let `n` samples pass; the readings of the two sensors on them."""
        with self._changed:
            is_counted = self.scenario.forces.exposure_counter
            counts = self.exposure_counts(self.now, n) if is_counted else None
            samples = np.arange(self.now, self.now + n)
            block = SampleBlock(self.now, self._volts(samples), counts, self._auxiliary(samples))
            self.now += n
            self._changed.notify_all()
        return block

    # ------------------------------------------------------------------ triggers

    def exposure_of(self, pulse: int) -> int | None:
        """Sample on which the camera begins to expose after a pulse of the board; None if it does
        not.
        """
        if (
            self.pulses is None
            or self.faults.hits("lost-trigger", pulse)
            or self.faults.since("camera-gone", pulse)
        ):
            return None
        late = self.faults.hits("late-trigger", pulse)
        usual = math.ceil(self.scenario.sim.exposure_lag * self.scenario.forces.sample_rate)
        return self.pulses.sample(pulse) + usual + (round(late.amount) if late else 0)

    def exposure_counts(self, first: int, n: int) -> I64:
        """How many exposures had begun by each of `n` samples from `first` on, as a counter beside
        the samples counts them, shape (n,).
        """
        with self._changed:
            due = self.pulses.count_before(first + n) if self.pulses else 0
            for pulse in range(self._pulses_counted, due):
                sample = self.exposure_of(pulse)
                if (
                    sample is not None
                    and not self.faults.hits("uncounted-exposure", pulse)
                    and not self.faults.since("exposure-wire", pulse)
                ):
                    bisect.insort(self.begun, sample)
            self._pulses_counted = max(self._pulses_counted, due)
            before = bisect.bisect_left(self.begun, first)
            return before + np.searchsorted(
                np.asarray(self.begun[before:], np.int64),
                np.arange(first, first + n),
                side="right",
            )

    # ------------------------------------------------------------------ stage

    def stage_m(self) -> float:
        """Travel of the stage since sample 0."""
        with self._changed:
            return self._stage(self.now)

    def is_moving(self) -> bool:
        """Whether the stage has not reached the target of its last move yet; a stalled one never
        does.
        """
        with self._changed:
            obstacle = self.obstacle()
            return self._stage(self.now) != self._moves[-1].target_m or (
                obstacle is not None and obstacle.kind == "stall"
            )

    def obstacle(self) -> Fault | None:
        """The fault that holds the stage although its move would take it further; None if it is
        free.
        """
        with self._changed:
            here, wall = self._stage(self.now), self._wall
            is_held = wall is not None and wall.place_m <= here < self._target_m
            return wall if is_held else None

    def move(self, target_m: float, velocity_m_s: float) -> None:
        """Send the stage to `target_m` (travel since sample 0) from this sample on, nominally at
        that speed.

        Raises
        ------
        OutOfLimits
            The move would shear the contact while it is being pressed, which is not modelled, or
            backwards under a law without memory. Nothing was done.
        """
        s = self.scenario
        with self._changed:
            here = self._stage(self.now)
            per_sample = velocity_m_s * s.speed_factor / s.forces.sample_rate
            way = target_m - here
            if way and self.now >= s.settled_sample and (s.loads or s.sim.pressure == "jkr"):
                raise OutOfLimits(
                    f"simulated stage: a move of {way * 1e6:.4g} um was requested in a contact that"
                    " adheres or whose load is changed, which is not modelled; move before the"
                    " contact, or use sim.pressure = 'hertz' and one load"
                )
            if self.now >= s.settled_sample:
                if way < 0 and not self._contact.has_memory:
                    raise OutOfLimits(
                        f"simulated stage: a move back by {-way * 1e6:.3g} um was requested in"
                        f" contact, which the law '{s.sim.law}' does not know; use"
                        " 'elasto-plastic', or make a new bench for another run"
                    )
                driven = self._driven_at(self.now)
                if way * self._way < 0:
                    self._turns.append((self.now, driven))
                elif way:
                    self._end_rest(driven)
                self._way = math.copysign(1.0, way) if way else self._way
            elif way and self.now + abs(way) / per_sample > s.press_sample:
                raise OutOfLimits(
                    f"simulated stage: a move of {way * 1e6:.4g} um was requested that lasts into"
                    f" the pressing of the contact (sample {s.press_sample} to {s.settled_sample}),"
                    " which is not modelled; move earlier, faster, or once the contact is settled"
                )
            self._target_m = target_m
            goal = target_m if self._wall is None else min(target_m, max(here, self._wall.place_m))
            self._set_out(here, goal, math.copysign(per_sample, way))

    def _end_rest(self, driven: float) -> None:
        """Note that the stage goes on the same way, after a hold if it stood."""
        following = self.now
        for move in reversed(self._moves):
            if move.target_m != move.start_m:
                arrives = move.sample + math.ceil((move.target_m - move.start_m) / move.speed)
                held = self.now - min(arrives, following)
                break
            following = move.sample
        else:
            return
        if held <= 0:
            return
        rest = Rest(driven, held / self.scenario.forces.sample_rate)
        try:
            self._contact.peak(self._turned(self.now), (*self._rested(self.now), rest))
        except ValueError as error:
            raise OutOfLimits(f"simulated stage: {error}") from None
        self._rests.append((self.now, rest))

    def follow(self, stage_m: float) -> None:
        """Put the stage where a real one is now, `stage_m` (travel since sample 0); in contact it
        is not followed backwards.
        """
        with self._changed:
            here = self._stage(self.now)
            stage_m = max(stage_m, here) if self.now >= self.scenario.settled_sample else stage_m
            self._set_out(stage_m, stage_m, 0.0)

    def halt(self) -> None:
        """Let the stage stand still from this sample on."""
        with self._changed:
            self._target_m = here = self._stage(self.now)
            self._set_out(here, here, 0.0)

    def _set_out(self, here: float, target_m: float, speed: float) -> None:
        before = self._moves[-1]
        carried = float(before.carried(np.asarray(self.now), self.scenario.sim.backlash))
        self._moves.append(SpindleMove(self.now, here, target_m, speed, carried))

    def _move_at(self, sample: int) -> SpindleMove:
        last = bisect.bisect_right(self._moves, sample, key=lambda move: move.sample) - 1
        return self._moves[last]

    def _stage(self, sample: int) -> float:
        return float(self._move_at(sample).at(np.asarray(sample)))

    def _place_at(self, sample: int) -> float:
        return float(self._move_at(sample).place(np.asarray(sample), self.scenario.sim))

    def _driven(self, samples: I64, place: F64) -> F64:
        """Distance by which the contact has been driven, including the drift that the stage does
        not report; 0 before the contact is settled.
        """
        s = self.scenario
        drift = s.sim.stage_drift / s.forces.sample_rate * (samples - s.settled_sample)
        return np.where(
            samples >= s.settled_sample, place + drift - self._place_at(s.settled_sample), 0.0
        )

    # ------------------------------------------------------------------ contact

    def _volts(self, samples: I64) -> F64:
        """The readings of the board; all `samples` are at or after the last command."""
        s = self.scenario
        P = s.load(samples)
        driven = self._driven(samples, self._moves[-1].place(samples, s.sim))
        Q = self._contact.shear_force(driven, self._past(samples))
        if s.weights:
            hung = np.array([(0, 0.0, 0.0), *s.weights])
            of = np.searchsorted(hung[:, 0], samples, side="right") - 1
            P, Q = P + hung[of, 1], Q + hung[of, 2]
        P, Q = self._conditioner.read(np.column_stack([P, Q])).T[..., None]
        noise = s.sim.force_noise * unit_noise(s.sim.seed, samples)
        if s.sim.hum or s.sim.zero_drift:
            t = samples / s.forces.sample_rate
            hum = math.sqrt(2) * s.sim.hum * np.sin(2 * math.pi * HUM_HZ * t)
            noise = noise + (hum + s.sim.zero_drift * t / 60)[:, None]
        step, top = s.volts_per_step, 2 ** (ADC_BITS - 1)
        from_normal, from_shear = np.transpose(s.forces.coupling)
        newtons = from_normal * P + from_shear * Q + noise
        per_volt = np.multiply(s.forces.stiffness, s.forces.sensitivity)
        codes = np.rint((newtons / per_volt + s.forces.zero) / step)
        for fault in self.faults.all:
            if fault.kind == "saturated":
                codes[samples >= fault.at, 1] = top
        return np.asarray(np.clip(codes, -top, top - 1) * step)

    def _auxiliary(self, samples: I64) -> F64 | None:
        """Volts of the further channels: channel i is near 1 + i/2 V, and wanders in a minute."""
        channels = self.scenario.forces.auxiliary_channels
        if not channels:
            return None
        wander = 0.1 * np.sin(2 * math.pi / 60 / self.scenario.forces.sample_rate * samples)
        return np.column_stack(
            [
                np.clip(1 + i / 2 + wander, -channel.range_v, channel.range_v)
                for i, channel in enumerate(channels)
            ]
        )

    def state(self, sample: int) -> TrueState:
        """The contact at a sample that has passed, or at the present one.

        Raises
        ------
        ValueError
            The sample has not come yet.
        """
        s = self.scenario
        with self._changed:
            if not 0 <= sample <= self.now:
                raise ValueError(
                    f"simulated world: there is no state at sample {sample} yet, it knows 0 to"
                    f" {self.now}"
                )
            at, stage = np.asarray(sample), self._stage(sample)
            past = self._past(at)
            place, driven = self._place_at(sample), self._driven_at(sample)
            contact = self._place_at(s.settled_sample)
        pressed = float(s.pressed(at, s.press_sample))
        P, Q = float(s.load(at)), float(self._contact.shear_force(np.asarray(driven), past))
        is_settled = sample >= s.settled_sample
        block = driven - Q / s.forces.stiffness_shear if is_settled else 0.0
        lens, pixel_m = s.sample.lens_compliance * Q, s.camera.pixel
        carried = contact + block if is_settled else place
        drift = [rate * pixel_m * sample / s.forces.sample_rate for rate in s.sim.image_drift]
        rigid = [
            PRESS_SHIFT_PX[i] * pixel_m * pressed + s.drive[i] * carried + drift[i] for i in (0, 1)
        ]
        centre = [s.contact_centre_px[i] * pixel_m + s.drive[i] * lens + drift[i] for i in (0, 1)]
        a = hertz.contact_radius(max(P, 0.0), *s.sample.bodies)
        adhering = adhering_faces(s, sample, P)
        seen = a + math.sqrt(s.sample.lens_radius * s.sample.roughness) if P > 0 else 0.0
        if isinstance(rough := self._rough(P), TabulatedPressure):
            seen = rough.reach
        return TrueState(
            sample=sample,
            normal_force_n=P,
            shear_force_n=Q,
            stage_m=stage,
            block_m=block,
            lens_m=lens,
            rigid_m=(rigid[0], rigid[1]),
            lens_centre_m=(centre[0], centre[1]),
            hertz_radius_m=a,
            apparent_radius_m=adhering.radius if adhering else seen,
            friction=s.mu,
            rough=rough,
            adhering=adhering,
            drive=s.drive,
            contact=self._contact.sheared(driven, past) if Q or past.turns else None,
        )

    def onset_sample(self) -> int | None:
        """First sample at which the whole contact slides; None if it does not slide yet."""
        with self._changed:
            settled = self.scenario.settled_sample
            end = self._turns[0][0] if self._turns else self.now
            samples = range(settled, end + 1)
            first = bisect.bisect_left(samples, self._contact.onset, key=self._driven_at)
            return samples[first] if first < len(samples) else None

    def _turned(self, sample: int) -> tuple[float, ...]:
        """Where the drive has turned back by a sample."""
        return tuple(driven for at, driven in self._turns if at <= sample)

    def _rested(self, sample: int) -> tuple[Rest, ...]:
        """The holds that have ended by a sample since the last turn before it."""
        last = max((at for at, _ in self._turns if at <= sample), default=-1)
        return tuple(rest for at, rest in self._rests if last < at <= sample)

    def _past(self, samples: I64) -> Past:
        first = int(samples.min())
        return Past(self._turned(first), self._rested(first), samples, self)

    def command_after(self, sample: int) -> int | None:
        """See `DriveInTime`."""
        i = bisect.bisect_right(self._moves, sample, key=lambda move: move.sample)
        return self._moves[i].sample if i < len(self._moves) else None

    def driven_from(self, begin: int, sample: int) -> float:
        """See `DriveInTime`."""
        at = np.asarray(sample)
        return float(self._driven(at, self._move_at(begin).place(at, self.scenario.sim)))

    def peaks(self) -> tuple[tuple[float, float], ...]:
        """See `Truth.peaks`."""
        P = self.scenario.normal_force
        with self._changed:
            return tuple(
                (rest.hold_s, self._contact.peak(self._turned(at), self._rested(at)) / P)
                for at, rest in self._rests
            )

    def _driven_at(self, sample: int) -> float:
        return float(self._driven(np.asarray(sample), np.asarray(self._place_at(sample))))

    def truth(self, sample: int) -> Truth:
        """The result that an analysis should have at a sample that has passed; an image shows the
        middle of its exposure.

        Raises
        ------
        ValueError
            The sample has not come yet.
        """
        s, slides, onset = self.scenario, np.asarray(self._contact.onset), self.onset_sample()
        past = FRESH if onset is None else Past(samples=np.asarray(onset), path=self)
        mu_s = float(self._contact.shear_force(slides, past)) / s.normal_force
        lens = Lens.of(s.sim.distortion, s.camera.shape)
        return Truth(
            self.state(sample), s.camera.pixel, mu_s, onset, self.state, lens, self.peaks()
        )
