"""Sessions made by hand: a reader of pictures, forces and positions that a test states."""

from types import SimpleNamespace

import numpy as np

from app.settings.config import load, to_toml


def reader_of(pictures, position_m, Q, *settings, rate=100):
    """A reader of a session with a picture in the middle of each stretch of 10 samples.

    `position_m` and `Q` are of shape (frames,): the stage and the shear force at each picture.
    """
    config = load(None, [f"forces.sample_rate={rate}", "camera.divisor=10", *settings])
    triggers = np.zeros(len(pictures), [("index", int), ("sample", int), ("received", bool)])
    triggers["index"], triggers["received"] = np.arange(len(pictures)), True
    triggers["sample"] = 10 * np.arange(len(pictures)) + 5
    forces = np.repeat(np.column_stack([0 * Q + 0.5, Q]), 10, axis=0)
    header = SimpleNamespace(
        config_toml=to_toml(config),
        sample_rate_hz=float(rate),
        frame_shape=pictures[0].shape if len(pictures) else config.camera.shape,
        auxiliary=None,
    )
    return SimpleNamespace(
        path="made.h5",
        pattern=lambda: None,
        header=header,
        events=list,
        triggers=lambda: triggers,
        frame=lambda index: (index, 0, pictures[index]),
        forces=lambda: SimpleNamespace(forces=forces, volts=forces, auxiliary=None),
        positions=lambda: (triggers["sample"][: len(position_m)], np.asarray(position_m)),
    )
