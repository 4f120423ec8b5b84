"""The tests as other processors would run them: on their linear algebra, on their instructions.

numpy and scipy each bring an OpenBLAS, which has kernels for every brand of processor that round
differently; numpy has loops, and numba compiles, for the instructions that it finds. Variables of
the environment choose others. (CasADi's OpenBLAS, which IPOPT uses, has but one set of kernels.)
"""

from __future__ import annotations

import argparse
import dataclasses
import os
import subprocess
import sys
import time
from collections.abc import Sequence

import numpy as np
from llvmlite import binding

#: What numpy has loops for besides the least that it needs.
_DISPATCHED: list[str] = np._core._multiarray_umath.__cpu_dispatch__  # type: ignore[attr-defined]
_FOUND: dict[str, bool] = np._core._multiarray_umath.__cpu_features__  # type: ignore[attr-defined]


@dataclasses.dataclass(frozen=True)
class Processor:
    """A processor to be imitated.

    Attributes:
        name: OpenBLAS's, or LLVM's.
        needs: instructions that this machine must have for it, in LLVM's words.
        environment: that imitates it.
    """

    name: str
    needs: tuple[str, ...]
    environment: dict[str, str]

    @property
    def missing(self) -> list[str]:
        """Instructions that this machine does not have."""
        found = binding.get_host_cpu_features()
        return [name for name in self.needs if not found.get(name, False)]


def _blas(name: str, *needs: str, without: Sequence[str] = ()) -> Processor:
    """OpenBLAS's kernels, and numpy's loops `without` those for some instructions."""
    off = [f for f in _DISPATCHED if _FOUND[f] and any(word in f for word in without)]
    environment = {"OPENBLAS_CORETYPE": name, "NPY_DISABLE_CPU_FEATURES": " ".join(off)}
    return Processor(name, needs, environment)


def _numba(name: str, *needs: str) -> Processor:
    """Numba's target; without the second variable it adds all that this machine has."""
    return Processor(name, needs, {"NUMBA_CPU_NAME": name, "NUMBA_CPU_FEATURES": ""})


PROCESSORS = (
    _blas("Haswell", "avx2", "fma", without=("512", "V4")),
    _blas("Zen", "avx2", "fma", without=("512", "V4")),
    _blas("SkylakeX", "avx512f", "avx512bw", "avx512dq", "avx512vl"),
    _blas("Prescott", "sse3", without=("",)),
    _numba("x86-64-v2", "sse4.2", "popcnt"),
    _numba("x86-64-v3", "avx2", "bmi2", "fma"),
)

#: What a process says about the kernels that its OpenBLAS uses.
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
    """Names of the kernels of numpy's and scipy's OpenBLAS, or "" where they do not tell."""
    command = [sys.executable, "-c", _PROBE]
    done = subprocess.run(command, capture_output=True, text=True, check=False, env=environment)
    return ", ".join(done.stdout.split()) if done.returncode == 0 else ""


def tested(processor: Processor, arguments: Sequence[str]) -> bool:
    """Whether pytest passes with these arguments on a processor."""
    environment = os.environ | processor.environment
    chosen = " ".join(f"{k}='{v}'" for k, v in processor.environment.items())
    print(f"\n=== {processor.name}: {chosen}", flush=True)
    print(f"=== OpenBLAS's kernels: {kernels(environment) or 'unknown'}", flush=True)
    command = [sys.executable, "-m", "pytest", *arguments]
    return subprocess.run(command, check=False, env=environment).returncode == 0


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the tests on one processor after the other; 1 if any failed."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    names = [processor.name for processor in PROCESSORS]
    parser.add_argument("names", nargs="*", metavar="NAME", help=f"of {', '.join(names)}; all")
    parser.add_argument("--pytest", default="", help="arguments of pytest, in one string")
    options = parser.parse_args(arguments)
    if unknown := set(options.names) - set(names):
        parser.error(f"unknown processor {', '.join(sorted(unknown))}: choose from {names}")
    results = []
    for processor in PROCESSORS:
        if options.names and processor.name not in options.names:
            continue
        begin = time.perf_counter()
        if processor.missing:
            result = f"skipped: this machine has no {', '.join(processor.missing)}"
        else:
            passed = tested(processor, options.pytest.split())
            result = f"{'passed' if passed else 'FAILED'} in {time.perf_counter() - begin:.0f} s"
        results.append(f"{processor.name:<10} {result}")
    print("\n" + "\n".join(results))
    return int(any("FAILED" in result for result in results))


if __name__ == "__main__":
    sys.exit(main())
