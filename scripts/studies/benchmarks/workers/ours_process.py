"""What a fresh process costs: imports, first steps, gaits, and memory for each environment."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
from typing import Any

from ..protocol import Measure, serve

# The first make() compiles and loads what all environments share. Tracing comes last, because it
# takes memory itself.
_MEMORY = """
import gc, json, resource, time, tracemalloc
import gymnasium, rimless_gym
def resident():
    gc.collect()
    pages = int(open("/proc/self/statm").read().split()[1])
    return resource.getpagesize() * pages
def make(n):{make}
begin, shared = time.perf_counter(), make(2)
before = resident()
kept = make({n})
grown = resident() - before
tracemalloc.start()
more = make({n})
traced = tracemalloc.get_traced_memory()[0]
print(json.dumps({{
    "steps": 1,
    "seconds": time.perf_counter() - begin,
    "envs": {n},
    "traced": traced / {n},
    "resident": grown / {n},
}}))
"""

# Imports are not counted, but anything that is compiled or loaded later is.
_GAIT = """
import json, time
from rimless_gym import BUILDABLE
from trajopt import periodic_gait
begin = time.perf_counter()
gait = periodic_gait(BUILDABLE, speed=0.5, steps=2, starts={starts})
assert gait.verification.passed
print(json.dumps({{"steps": 1, "seconds": time.perf_counter() - begin}}))
"""

#: Each prints a JSON object. Except for gaits, `seconds` includes the imports.
PROGRAMS = {
    "import": """
import json, time
begin = time.perf_counter()
import rimless_gym
print(json.dumps({"steps": 1, "seconds": time.perf_counter() - begin}))
""",
    "single": """
import json, time
begin = time.perf_counter()
import gymnasium, rimless_gym
env = gymnasium.make("RimlessWheel-v0")
env.reset(seed=0)
env.step(env.action_space.sample())
print(json.dumps({"steps": 1, "seconds": time.perf_counter() - begin}))
""",
    "vector": """
import json, time
begin = time.perf_counter()
import gymnasium, rimless_gym
env = gymnasium.make_vec("RimlessWheel-v0", num_envs=64)
env.reset(seed=0)
env.step(env.action_space.sample())
print(json.dumps({"steps": 1, "seconds": time.perf_counter() - begin}))
""",
    "gait": _GAIT.format(starts="None"),
    "gaits": _GAIT.format(starts=32),
    "memory-vector": _MEMORY.format(
        n=16384,
        make="""
    env = gymnasium.make_vec("RimlessWheel-v0", num_envs=n)
    env.reset(seed=0)
    env.step(env.action_space.sample())
    return env
""",
    ),
    "memory-single": _MEMORY.format(
        n=1000,
        make="""
    envs = [gymnasium.make("RimlessWheel-v0") for _ in range(n)]
    for env in envs:
        env.reset(seed=0)
        env.step(env.action_space.sample())
    return envs
""",
    ),
}


def setup(settings: dict[str, Any]) -> tuple[Measure, dict[str, Any]]:
    """Each measurement is one fresh process, however long it takes."""
    program = PROGRAMS[settings["program"]]

    def measure(seconds: float) -> dict[str, Any]:
        with tempfile.TemporaryDirectory() as empty:
            cold = {"NUMBA_CACHE_DIR": empty} if settings.get("cold") else {}
            run = subprocess.run(
                [sys.executable, "-c", program],
                env=os.environ | cold,
                capture_output=True,
                text=True,
                check=False,
            )
        if run.returncode:
            raise RuntimeError(run.stderr.strip().splitlines()[-1])
        answer: dict[str, Any] = json.loads(run.stdout)
        return answer

    return measure, {"version": "rimless-gym"}


if __name__ == "__main__":
    serve(setup)
