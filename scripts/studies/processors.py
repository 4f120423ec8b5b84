"""Run the tests as other processors would run them: with their linear algebra and instructions.

numpy and scipy each bring an OpenBLAS, whose kernels for different processors round differently;
numpy has loops, and numba compiles, for the instruction set that it finds. Environment variables
choose others. A processor whose instructions this machine does not have is skipped.
"""

from __future__ import annotations

import os
import subprocess
import sys

import numpy as np
from llvmlite import binding

from agents.cli.options import Names, chosen

LOOPS: list[str] = np._core._multiarray_umath.__cpu_dispatch__  # type: ignore[attr-defined]
FOUND: dict[str, bool] = np._core._multiarray_umath.__cpu_features__  # type: ignore[attr-defined]


def blas(name: str, without: str = " ") -> dict[str, str]:
    """Variables for OpenBLAS's kernels of a name, and numpy's loops without some instructions."""
    off = [loop for loop in LOOPS if FOUND[loop] and any(word in loop for word in without.split())]
    return {"OPENBLAS_CORETYPE": name, "NPY_DISABLE_CPU_FEATURES": " ".join(off)}


#: By name: instructions that this machine must have, as LLVM calls them, and variables. Without
#: the second variable, numba would add all instructions that this machine has.
PROCESSORS = {
    "Haswell": ("avx2 fma", blas("Haswell", without="512 V4")),
    "SkylakeX": ("avx512f avx512bw avx512dq avx512vl", blas("SkylakeX")),
    "x86-64-v2": ("sse4.2 popcnt", {"NUMBA_CPU_NAME": "x86-64-v2", "NUMBA_CPU_FEATURES": ""}),
}


def processors(*, names: Names = (), pytest: str = "") -> int:
    """Run the tests as one processor after the other; the exit status is 1 if any failed.

    Args:
        names: of processors; all by default.
        pytest: arguments of pytest, in one string: --pytest='-n 2 tests'.
    """
    results, features = {}, binding.get_host_cpu_features()
    for name in chosen(names, list(PROCESSORS)):
        needs, variables = PROCESSORS[name]
        if missing := [need for need in needs.split() if not features.get(need, False)]:
            results[name] = f"skipped: this machine has no {', '.join(missing)}"
            continue
        print(f"\n=== {name}: {variables}", flush=True)
        command = [sys.executable, "-m", "pytest", *pytest.split()]
        done = subprocess.run(command, check=False, env=os.environ | variables)
        results[name] = "FAILED" if done.returncode else "passed"
    print("\n".join(["", *(f"{name:<10} {result}" for name, result in results.items())]))
    return int("FAILED" in results.values())
