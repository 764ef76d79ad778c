"""What docs/notebooks.md says of scripts runs: `slipscope.run`, `export`, `analyze`, `figures`."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest
from test_public_names import blocks

import slipscope

BENCH = """
[camera]
width = 320
height = 240
[run]
travel = 4
[stress]
method = "none"
"""


def test_the_examples_of_the_page_run(
    sessions: list[Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("bench.toml").write_text(BENCH, encoding="utf-8")
    reads, does, computes, *_ = blocks("notebooks.md")
    begins, ends, more = does.partition("r = slipscope.analyze")
    names: dict[str, object] = {"slipscope": slipscope}
    exec(compile(begins, "docs/notebooks.md", "exec"), names)
    assert Path("rings.csv").read_text(encoding="utf-8").startswith("frame,time_s,r_mm,ux_um")
    with slipscope.Session("sample8.h5") as s:
        assert (s.state, s.settings["run"]["normal_force"]) == ("done", 0.7)
    # two that go together; the correlation of each as it was, which takes less time
    shutil.copy(sessions[0], "sample7.h5")
    shutil.copy(sessions[1], "sample8.h5")
    quick = more.replace('"results.h5")', '"results.h5", preset="session")', 1)
    assert quick != more
    exec(compile(ends + quick, "docs/notebooks.md", "exec"), names)
    drawn = sorted(path.name for path in Path("paper").glob("*.svg"))
    assert drawn == ["fig05.svg", "fig06a.svg", "fig15.svg"]
    exec(compile(reads, "docs/notebooks.md", "exec"), names)
    assert len(names["loads"]) == 2
    exec(compile(computes, "docs/notebooks.md", "exec"), names)
    assert names["kymograph"].shape[1:] == names["sigma_pa"].shape[1:]
    assert names["shear_n"] > 0
    written = slipscope.figures("results.h5", "again", [5], formats=["png"])
    assert written == {"5": [Path("again/fig05.png"), Path("again/fig05.csv")]}
    assert all(path.is_file() for path in written["5"])
    with pytest.raises(slipscope.UserError, match="figure 99: there is none"):
        slipscope.figures("results.h5", "more", [99])
    with pytest.raises(slipscope.UserError, match="the folder is not empty"):
        slipscope.figures("results.h5", "again", [5])
