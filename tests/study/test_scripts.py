"""What docs/notebooks.md says of scripts runs: `slipscope.run`, `export`, `analyze`, `figures`."""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
import pytest
from matplotlib import pyplot
from numpy.testing import assert_allclose
from PIL import Image
from test_public_names import blocks

import slipscope
from app.records.study_results import StudyResults
from app.study import worker

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
    sessions: list[Path], results: StudyResults, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    known = {f"sample{n}.h5": run for n, run in enumerate(results.runs, 7)}  # analysed before
    monkeypatch.setattr(worker, "run_result", lambda path, *_: known[path.name])
    Path("bench.toml").write_text(BENCH, encoding="utf-8")
    reads, does, computes, inverts, plots, opens, *_ = blocks("notebooks.md")
    begins, ends, more = does.partition("r = slipscope.analyze")
    names: dict[str, object] = {"slipscope": slipscope}
    exec(compile(begins, "docs/notebooks.md", "exec"), names)
    assert Path("rings.csv").read_text(encoding="utf-8").startswith("frame,time_s,r_mm,ux_um")
    with slipscope.Session("sample8.h5") as s:
        assert (s.state, s.settings["run"]["normal_force"]) == ("done", 0.7)
    # two that go together
    shutil.copy(sessions[0], "sample7.h5")
    shutil.copy(sessions[1], "sample8.h5")
    quick = more.replace('"results.h5")', '"results.h5", preset="session", jobs=1)', 1)
    assert quick != more
    exec(compile(ends + quick, "docs/notebooks.md", "exec"), names)
    drawn = sorted(path.name for path in Path("paper").glob("*.svg"))
    assert drawn == ["fig05.svg", "fig06a.svg", "fig15.svg"]
    exec(compile(reads, "docs/notebooks.md", "exec"), names)
    assert len(names["loads"]) == 2
    exec(compile(computes, "docs/notebooks.md", "exec"), names)
    assert names["kymograph"].shape[1:] == names["sigma_pa"].shape[1:]
    assert names["shear_n"] > 0
    pyplot.switch_backend("agg")
    exec(compile(inverts, "docs/notebooks.md", "exec"), names)
    assert len(inverts.strip().splitlines()) == 3
    assert_allclose(1e3 * names["sigma_kpa"], names["sigma_pa"])
    exec(compile(plots, "docs/notebooks.md", "exec"), names)
    assert [axes.get_title() for axes in names["figure"].axes] == ["sample7.h5", "at the end"]
    pyplot.close("all")
    exec(compile(opens, "docs/notebooks.md", "exec"), names)
    pyplot.close("all")
    assert names["both"]["ux"].dims == ("frame", "y", "x")
    assert names["loads"].sizes == {"normal_force": 2}
    assert names["ux_um"].attrs["units"] == "um"
    written = slipscope.figures("results.h5", "again", [5], formats=["png"])
    assert written == {"5": [Path("again/fig05.png"), Path("again/fig05.csv")]}
    assert all(path.is_file() for path in written["5"])
    look = {"width": 120, "colours": "grey", "style": "ggplot"}
    (picture, _), *_ = slipscope.figures(
        "results.h5", "grey", [5], formats=["png"], **look
    ).values()
    plain, grey = (
        np.asarray(Image.open(path).convert("RGB"), int) for path in ("again/fig05.png", picture)
    )
    assert grey.shape[1] == pytest.approx(120 / 25.4 * 300, abs=1)
    assert (grey == 229).all(axis=2).mean() > 0.2  # the ground of that style
    assert (np.ptp(grey, axis=2) > 50).mean() < 0.5 * (np.ptp(plain, axis=2) > 50).mean()
    for wrong in ({"width": 59}, {"colours": "pink"}, {"style": "nowhere"}):
        with pytest.raises(slipscope.UserError, match=f"--{next(iter(wrong))} "):
            slipscope.figures("results.h5", "more", [5], **wrong)
        assert not Path("more").exists()
    with pytest.raises(slipscope.UserError, match="figure 99: there is no such figure"):
        slipscope.figures("results.h5", "more", [99])
    with pytest.raises(slipscope.UserError, match="the folder is not empty"):
        slipscope.figures("results.h5", "again", [5])
