"""Settings of experiments that take seconds: each the smallest that still shows what its tests look
for.
"""

from contextlib import contextmanager

import pytest

from app.evaluation import conclusions
from app.evaluation.budget import Budget

# The sliding of smooth, rigid faces has closed forms.
RIGID = ("sim.law=cattaneo-mindlin", "sim.pressure=hertz")
# a small contact in a small picture: 0.03 N, 0.86 mm, 22 um of travel
SHORT = (
    *RIGID,
    "camera.width=400",
    "camera.height=300",
    "run.normal_force=0.03",
    "run.travel=22",
    "run.background_time=0.5",
    "run.settle_time=0.3",
    "run.settle_tolerance=0.1",
    "run.shear_tolerance=0.2",
    "sim.force_noise=0.02",
    "sim.press_time=0.75",
)
# For tests of the bench: the contact slides after 5.5 s of a drive of 12 s, which begins at sample
# DRIVE. No traction: the summary of one takes longer than the run itself.
SMALL = (
    *RIGID,
    "camera.width=480",
    "camera.height=360",
    "camera.pixel=16",
    "run.normal_force=0.1",
    "run.background_time=0.2",
    "sim.press_time=0.3",
    "run.settle_time=0.2",
    "run.reference_time=0.4",
    "run.travel=60",
    "dic.threads=1",
    "stress.method=none",
)
DRIVE = 1800
TRACTION = "stress.method=axisymmetric"
# small pictures, of which nothing but their bytes is asked
BLIND = ("recording.results=forces", "camera.width=96", "camera.height=96")


@contextmanager
def without_budget():
    """Conclude without the shares of the inputs, which take as long as all else together."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(conclusions, "_spent", lambda *_: Budget())
        yield


def without_pictures(patch: pytest.MonkeyPatch) -> None:
    """Do not draw the picture of a run, which takes as long as a short run itself."""
    write = "app.report.figures.write_picture"
    patch.setattr(write, lambda _figure, path: path.write_bytes(b"a picture"))
