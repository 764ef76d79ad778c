"""The same bits on every x86-64 processor of the last ten years: none uses wider vectors than the
others.
"""

from __future__ import annotations

import os
import sys

from app.system.errors import UserError

TARGET = "x86-64-v3"  # fused multiplication and vectors of 256 bits (AVX2)
# what the libraries read when they are loaded; other processes inherit it
CHOSEN = {"NUMBA_CPU_NAME": TARGET, "NUMBA_CPU_FEATURES": "", "OPENBLAS_CORETYPE": "Haswell"}
NARROWED = {  # where there are vectors of 512 bits
    "NPY_DISABLE_CPU_FEATURES": "X86_V4 AVX512F AVX512_SKX AVX512_ICL AVX512_SPR",
    "OPENCV_CPU_DISABLE": "AVX512-SKX",
}


def same_everywhere() -> None:
    """Let numba, numpy, OpenBLAS and OpenCV use these instructions only.

    Raises
    ------
    UserError
        The processor does not have them.
    """
    assert "numpy" not in sys.modules, "numpy has chosen its instructions already"
    from llvmlite import binding

    features = binding.get_host_cpu_features()
    if not (features.get("avx2") and features.get("fma")):
        raise UserError(
            f"--reproducible: it computes with the instructions of {TARGET}, which this processor"
            f" ({binding.get_host_cpu_name()}) does not have; leave it out"
        )
    os.environ |= CHOSEN | (NARROWED if features.get("avx512f") else {})
