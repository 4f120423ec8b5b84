"""Other processors, and the environment variables that make this one round as they do.

numpy and scipy each bring an OpenBLAS, whose kernels for different processors round differently.
numpy also has loops for several instruction sets, and numba compiles for the instruction set that
it finds. Environment variables choose others. (CasADi's OpenBLAS, which IPOPT uses, has only one
set of kernels.)
"""

from __future__ import annotations

import dataclasses
import subprocess
import sys
from collections.abc import Sequence

import numpy as np
from llvmlite import binding

#: Instructions for which numpy has loops, beyond those that it always needs, and whether they are
#: there.
_DISPATCHED: list[str] = np._core._multiarray_umath.__cpu_dispatch__  # type: ignore[attr-defined]
_FOUND: dict[str, bool] = np._core._multiarray_umath.__cpu_features__  # type: ignore[attr-defined]


@dataclasses.dataclass(frozen=True)
class Processor:
    """A processor to imitate.

    Attributes:
        name: as OpenBLAS or LLVM calls it.
        needs: instructions that this machine must have, as LLVM calls them.
        environment: variables that make this machine imitate it.
    """

    name: str
    needs: tuple[str, ...]
    environment: dict[str, str]

    @property
    def missing(self) -> list[str]:
        """Needed instructions that this machine does not have."""
        found = binding.get_host_cpu_features()
        return [name for name in self.needs if not found.get(name, False)]


def _blas(name: str, *needs: str, without: Sequence[str] = ()) -> Processor:
    """One with OpenBLAS's kernels of that name, and numpy's loops `without` some instructions."""
    off = [f for f in _DISPATCHED if _FOUND[f] and any(word in f for word in without)]
    environment = {"OPENBLAS_CORETYPE": name, "NPY_DISABLE_CPU_FEATURES": " ".join(off)}
    return Processor(name, needs, environment)


def _numba(name: str, *needs: str) -> Processor:
    """One for which numba compiles.

    Without the second variable, numba would add all instructions that this machine has.
    """
    return Processor(name, needs, {"NUMBA_CPU_NAME": name, "NUMBA_CPU_FEATURES": ""})


PROCESSORS = (
    _blas("Haswell", "avx2", "fma", without=("512", "V4")),
    _blas("Zen", "avx2", "fma", without=("512", "V4")),
    _blas("SkylakeX", "avx512f", "avx512bw", "avx512dq", "avx512vl"),
    _blas("Prescott", "sse3", without=("",)),
    _numba("x86-64-v2", "sse4.2", "popcnt"),
    _numba("x86-64-v3", "avx2", "bmi2", "fma"),
)

#: Prints the names of the kernels that the OpenBLAS libraries of a process use.
_PROBE = """
import ctypes, numpy, scipy.linalg
names = ("scipy_openblas_get_corename64_", "scipy_openblas_get_corename", "openblas_get_corename")
for path in sorted({line.split()[-1] for line in open("/proc/self/maps") if "openblas" in line}):
    library = ctypes.CDLL(path)
    for get in (getattr(library, name) for name in names if hasattr(library, name)):
        get.restype = ctypes.c_char_p
        print(get().decode())
        break
"""


def kernels(environment: dict[str, str]) -> str:
    """Names of the kernels that numpy's and scipy's OpenBLAS use, or "" if they cannot be found.

    Args:
        environment: variables of the process that is asked.
    """
    command = [sys.executable, "-c", _PROBE]
    done = subprocess.run(command, capture_output=True, text=True, check=False, env=environment)
    return ", ".join(done.stdout.split()) if done.returncode == 0 else ""
