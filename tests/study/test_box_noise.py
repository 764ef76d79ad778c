"""The scatter of u_x against the box, by the method of a run and by the direct one."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from app.settings.config import from_data
from app.study import noise


@pytest.mark.parametrize("method", ["shared", "direct"])
def test_each_method_is_measured_once(method: str, monkeypatch: pytest.MonkeyPatch) -> None:
    measured: list[tuple[str, int]] = []

    def errors(tracking: Any, box: int) -> tuple[float, float, float]:
        measured.append((tracking["method"], box))
        return 0.0, box + 1000.0 * (tracking["method"] == "direct"), 0.0

    timer = SimpleNamespace(errors=errors, floor=lambda box, step: 0.0)
    monkeypatch.setattr(noise, "VariantTimer", lambda *_: timer)
    monkeypatch.setattr(noise, "texture_of", lambda *_: SimpleNamespace(end=255))
    monkeypatch.setattr(noise, "Tracking", lambda settings, *_: settings)
    config = from_data({"dic": {"method": method}}, "settings")
    found = noise.box_noise(config, np.zeros((9, 9), np.uint8), [])
    assert len(measured) == len(set(measured)) == len(noise.BOXES) * len({method, "direct"})
    boxes = np.array(noise.BOXES, float)
    np.testing.assert_array_equal(found.sigma_px, boxes + 1000 * (method == "direct"))
    np.testing.assert_array_equal(found.direct_px, boxes + 1000)
