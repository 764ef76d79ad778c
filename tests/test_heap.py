"""Memory that is freed stays with the process: pages are not cleared again for each image."""

from __future__ import annotations

import platform
import subprocess
import sys

import pytest

IMAGES = """
import resource
import sys
from app.system.heap import keep_freed_memory

size, faults = 8_000_000, []
if sys.argv[1] == "kept":
    keep_freed_memory()
for _ in range(3):
    images = [bytes([n]) * size for n in range(4)]
    del images
    faults.append(resource.getrusage(resource.RUSAGE_SELF).ru_minflt)
print(faults[2] - faults[1])
"""


@pytest.mark.skipif(platform.libc_ver()[0] != "glibc", reason="needs the C library of GNU")
def test_freed_memory_is_used_again() -> None:
    faults = {}
    for how in ("kept", "given back"):
        command = [sys.executable, "-c", IMAGES, how]
        done = subprocess.run(command, capture_output=True, text=True, check=True, timeout=400)
        faults[how] = int(done.stdout)
    assert faults["given back"] > 1000
    assert faults["kept"] < 20
