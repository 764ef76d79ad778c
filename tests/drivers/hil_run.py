"""A whole run of the emulated bench: the real drivers of NI, Basler and Newport against emulators
that see one simulated world.
"""

from pathlib import Path

import numpy as np
import short_run
from whole_runs import RunFile

from app.runs import live
from app.settings import config
from drivers.sim.images import Renderer

SMALL = (*short_run.SMALL, "run.travel=30")
# longer than a run: a busy machine may be late, the world's time passes all the same
PATIENT = "forces.buffer=60"
# how a run of a healthy bench ends, at the default limits, on a machine that was busy for so long:
# the forces are too old, or the world has pressed the block before the program looked at it
LATE = "(limits.age) while the stage moves", "while the block should hang free"
ATTEMPTS = 4


class HilRun(RunFile):
    """One run, ended: outcome, world, and what the file holds.

    A run that only the machine was too late for is repeated, unless the test does something itself
    `while_running`. `before` is called with the bench before it is opened.
    """

    def __init__(self, path, *overrides, pace=2.0, while_running=None, before=lambda bench: None):
        self.path, self._before = path, before
        self.settings = config.load(Path("hil-emulated"), [*SMALL, PATIENT, *overrides])
        for _ in range(1 if while_running else ATTEMPTS):
            self._carry_out(path, pace, while_running)
            if while_running or not any(late in self.outcome.reason for late in LATE):
                break
            path.unlink()
        self.read(path, self.settings.run.travel)
        assert all(
            0 <= move.target_m <= self.settings.run.travel + 40e-9  # a step of the encoder
            for move in self.world._moves
        )

    def _carry_out(self, path, pace, while_running):
        self.run = live.make_run(self.settings, path, pace=pace)
        self.bench = self.run._bench
        self._before(self.bench)
        self.run.start()
        if while_running:
            while_running(self)
        self.end()

    def wrong_frames(self, among=None):
        """Indices of recorded images that are not, to the bit, the world at the sample that the
        file gives them.
        """
        renderer, half = Renderer(self.world.scenario), self.world.scenario.exposure_samples // 2
        looked_at = among or self.frames
        return [
            index
            for index in looked_at
            if not np.array_equal(
                self.frames[index][1],
                renderer.image(self.world.state(self.frames[index][0] + half), index),
            )
        ]

    def wrong_certain_frames(self):
        """Those among them that the file calls certain."""
        return [index for index in self.wrong_frames() if index not in self.uncertain]
