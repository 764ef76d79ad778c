"""Memory that is freed stays with the process, for all of its threads: pages are not cleared again
for each image.
"""

from __future__ import annotations

import platform

import pytest
from python_program import python

IMAGES = """
import resource
import sys
import threading
from app.system.heap import keep_freed_memory

size, faults, is_over = 8_000_000, [], threading.Event()
if sys.argv[1] == "kept":
    keep_freed_memory()


def use():
    is_used = threading.Event()

    def images():
        before = resource.getrusage(resource.RUSAGE_THREAD).ru_minflt
        [bytes([n]) * size for n in range(4)]
        faults.append(resource.getrusage(resource.RUSAGE_THREAD).ru_minflt - before)
        is_used.set()
        is_over.wait()

    threading.Thread(target=images).start()
    is_used.wait()


for _ in range(3):
    use()
is_over.set()
print(faults[2])
"""


@pytest.mark.skipif(platform.libc_ver()[0] != "glibc", reason="needs the C library of GNU")
def test_freed_memory_is_used_again() -> None:
    faults = {}
    for how in ("kept", "given back"):
        faults[how] = int(python("-c", IMAGES, how).stdout)
    assert faults["given back"] > 1000
    assert faults["kept"] < 20
