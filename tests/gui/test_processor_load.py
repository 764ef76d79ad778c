"""How much of the processor the program is said to use."""

from types import SimpleNamespace

import psutil
import pytest

from app.gui import load


def test_processes_that_come_are_counted_and_looked_for_every_five_seconds(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """A look for others reads of each process of the computer, and holds up the window."""
    now_s, listed, asked = 0.0, [], []

    class Process:
        def __init__(self, pid: int = 1) -> None:
            self.pid = pid

        def cpu_percent(self, interval: None) -> float:
            asked.append((now_s, self.pid))
            if self.pid == 3:
                raise psutil.NoSuchProcess(self.pid)
            return 50.0

        def children(self, recursive: bool) -> list["Process"]:
            listed.append(now_s)
            return [Process(2)] * (now_s > 2) + [Process(3)] * (now_s > 7)

    monkeypatch.setattr(load.psutil, "Process", Process)
    monkeypatch.setattr(load, "time", SimpleNamespace(monotonic=lambda: now_s))
    processor, cores = load.ProcessorLoad(), {}
    while now_s < 12:
        cores[now_s] = processor.cores()
        now_s += 0.5
    assert listed == [0.0, 5.0, 10.0]
    assert [at for at, pid in asked if pid == 1] == [float(n) for n in range(12)]
    assert {at: cores[at] for at in (0.0, 4.5, 5.0, 11.5)} == {
        0.0: 0.5,
        4.5: 0.5,
        5.0: 1.0,
        11.5: 1.0,
    }
