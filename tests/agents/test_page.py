"""The page is one file that loads nothing, and its network and gaits are the package's."""

from __future__ import annotations

import json
import re
import shutil
import subprocess
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from agents.page import front_data, network_data, page
from agents.policy_files import load_policy
from rimless_gym import BUILDABLE
from rimless_gym.envs.layout import observe
from rimless_gym.javascript import simulator
from rimless_gym.kernel.stepping import STATE_SIZE
from trajopt.gaits.fronts import shipped_front

STATIC = Path(page.__code__.co_filename).parent / "static" / "page"


@pytest.fixture(scope="module")
def text() -> str:
    return page()


@pytest.fixture(scope="module")
def gaits() -> list[dict[str, Any]]:
    return front_data(shipped_front(BUILDABLE))


def test_the_page_is_small_and_the_same_every_time(text: str) -> None:
    assert len(text.encode()) < 1_000_000
    assert text == page()


def test_the_page_loads_nothing(text: str) -> None:
    assert not re.search(r"https?:|//cdn|@import|<link[^>]+href=\"(?!data:)|\bsrc=|fetch\(", text)
    assert "{{" not in re.sub(r"<script>.*</script>", "", text, flags=re.DOTALL)


def test_the_page_holds_the_printed_physics_and_no_equation_of_its_own(text: str) -> None:
    assert simulator() in text
    for path in STATIC.glob("*.js"):
        assert not re.search(r"p\.(Je1|Je2|Je3|S1|S2|gx|gy|F0)\b", path.read_text()), path


def test_every_gait_of_the_front_costs_what_was_verified(gaits: list[dict[str, Any]]) -> None:
    for gait in gaits:
        length = gait["speed"] * sum(gait["durations"])
        spent = sum(gait["spent"].values()) / length / BUILDABLE.weight
        assert spent == pytest.approx(gait["cot"], rel=1e-3)


def test_networks_of_all_learners_are_taken_and_other_policies_refused() -> None:
    assert len(network_data(load_policy("evolved"))) == 3  # its algorithm is CMA-ES
    for name in ("evolution", "front"):  # no network; a commanded speed
        with pytest.raises(ValueError, match="networks of tanh layers"):
            network_data(load_policy(name))


@pytest.mark.skipif(shutil.which("node") is None, reason="no Node here")
def test_the_network_in_the_page_is_the_policy(text: str) -> None:
    policy, rng = load_policy("imitation"), np.random.default_rng(0)
    states = np.zeros((40, STATE_SIZE))
    states[:, :4] = rng.uniform([1.2, -9, -3, -15], [1.9, 9, 3, 15], (40, 4))
    data = re.search(r"^const DATA = .*;$", text, flags=re.MULTILINE)
    assert data is not None
    names = ("phi", "theta", "dphi", "dtheta", "mode")
    given = [dict(zip(names, x[:5].tolist(), strict=True)) for x in states]
    program = "\n".join(
        [
            data[0],
            simulator(),
            (STATIC / "numbers.js").read_text(),
            (STATIC / "network.js").read_text(),
            "const p = wheel.constants(DATA.machine);",
            f"const given = {json.dumps(given)};",
            "console.log(JSON.stringify(given.map((x) => policyVoltage(x, p, DATA.machine))));",
        ]
    )
    done = subprocess.run(["node", "-"], input=program, capture_output=True, text=True, check=True)
    wanted = BUILDABLE.voltage_limit * policy.act(observe(BUILDABLE, states))
    np.testing.assert_allclose(json.loads(done.stdout), wanted, atol=2e-4)
