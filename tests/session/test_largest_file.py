"""A recording on a disk that holds no larger file: said before the run, ended in good order when it
is reached, and safe where the limit was not known.
"""

import math
import sys
from collections import namedtuple

import pytest
from short_run import SHORT

from app.runs import live
from app.session import recorder
from app.session.files import RESERVE_BYTES
from app.session.reader import SessionReader
from app.session.repair import repair
from app.settings import config
from app.system import disk
from app.system.errors import UserError

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="limits of POSIX")
QUICK = (*SHORT, "stress.method=none", "run.travel=4")
MOST = 2 << 20  # bytes


@pytest.fixture
def limited():
    """Sets the size of the largest file of this process."""
    import resource

    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    yield lambda size: resource.setrlimit(resource.RLIMIT_FSIZE, (size, before[1]))
    resource.setrlimit(resource.RLIMIT_FSIZE, before)


def test_a_run_that_the_file_system_can_not_hold_is_refused_before_it_starts(
    tmp_path, limited, monkeypatch
):
    settings = config.load(None, list(QUICK))
    limited(RESERVE_BYTES)
    with pytest.raises(
        UserError, match=r"needs about 0\.\d+ GB, and ulimit -f takes no file above"
    ):
        live.make_run(settings, tmp_path / "a.h5", pace=None)
    small = config.load(None, [*QUICK, "recording.compression=gzip"])  # how small, is not known yet
    live.check_room(small, tmp_path / "a.h5")
    Disk = namedtuple("Disk", "mountpoint fstype")
    mounted = [Disk("/", "ext4"), Disk(str(tmp_path), "vfat")]
    monkeypatch.setattr(disk.psutil, "disk_partitions", lambda all: mounted)
    limited(-1)
    assert disk.largest_file(tmp_path / "a.h5") == ((1 << 32) - 1, "the file system vfat")
    assert disk.largest_file(tmp_path.parent / "a.h5") == (math.inf, "")
    assert not list(tmp_path.iterdir())


def run(path, monkeypatch):
    monkeypatch.setattr(live, "expected_bytes", lambda config: 0)  # it lasts longer than planned
    under_way = live.make_run(config.load(None, list(QUICK)), path, pace=None)
    under_way.start()
    outcome = under_way.wait(400)
    assert outcome.state == "failed"
    assert outcome.counts.frames_recorded > 0
    return outcome


def images_of(path):
    with SessionReader(path) as session:
        return len(list(session.frames()))


def test_a_recording_that_reaches_a_known_limit_ends_with_a_whole_session(
    tmp_path, limited, monkeypatch
):
    limited(RESERVE_BYTES + MOST)
    path = tmp_path / "a.h5"
    outcome = run(path, monkeypatch)
    assert outcome.reason.startswith("recorder: the session cannot be written: ")
    assert "ulimit -f takes no file above 0.04 GB; record to another disk" in outcome.reason
    assert images_of(path) == outcome.counts.frames_recorded


def test_a_recording_that_reaches_an_unknown_limit_can_be_repaired(tmp_path, limited, monkeypatch):
    monkeypatch.setattr(recorder, "largest_file", lambda path: (math.inf, ""))
    limited(MOST)
    path = tmp_path / "a.h5"
    outcome = run(path, monkeypatch)
    assert "a.h5.images cannot be written: File too large" in outcome.reason
    assert f"`slipscope repair {path} -o REPAIRED.h5` makes a session" in outcome.reason
    limited(-1)
    repair(path, tmp_path / "repaired.h5")
    assert images_of(tmp_path / "repaired.h5") == outcome.counts.frames_recorded
