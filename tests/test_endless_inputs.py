"""Settings, campaigns and tables that never end are refused by one sentence."""

import os
import sys
from pathlib import Path

import pytest

from app.campaigns.plan import read_campaign
from app.files.field_files import read_fields
from app.files.text_tables import NUMBER, read_table
from app.settings.config import read_settings
from app.system.errors import UserError

pytestmark = [
    pytest.mark.skipif(sys.platform == "win32", reason="pipes and devices of POSIX"),
    pytest.mark.timeout(120),
]


def settings(path):
    return read_settings(path)


def campaign(path):
    return read_campaign(path)


def table(path):
    return read_table(path, {"p": NUMBER})


def fields(path):
    return read_fields(path, None)


@pytest.mark.parametrize("read", [settings, campaign, table, fields])
@pytest.mark.parametrize("what", ["pipe", "device", "holes"])
def test_what_never_ends_is_refused(read, what, tmp_path):
    path = tmp_path / ("odd.toml" if read in (settings, campaign) else "odd.csv")
    if what == "pipe":
        os.mkfifo(path)
    elif what == "device":
        path.symlink_to("/dev/zero")
    else:
        with path.open("wb") as file:
            file.truncate(1 << 36)
    found = "nothing but holes|the rest is holes" if what == "holes" else "a pipe or a device"
    with pytest.raises((UserError, ValueError), match=rf"odd.*cannot be read: .*({found})"):
        read(path)


def test_a_link_to_a_file_is_a_file(tmp_path):
    (tmp_path / "a.csv").write_text("p\n1\n2\n", encoding="utf-8")
    (tmp_path / "b.csv").symlink_to(Path("a.csv"))
    assert table(tmp_path / "b.csv").rows == 2
