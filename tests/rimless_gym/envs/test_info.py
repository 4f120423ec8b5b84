"""What info holds, and the single environment's info, which is filled in when it is first read."""

from __future__ import annotations

import copy
import json
import pickle
import sys
import types
from typing import Any

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.vector import AutoresetMode

from rimless_gym.envs.env import RimlessWheelEnv
from rimless_gym.equations import DOUBLE, SINGLE
from rimless_gym.hybrid import Failure
from tests.rimless_gym.envs.rows import NEXT, ROUGH, SAME, make, swinging


def test_info_behaves_like_a_dictionary_however_it_is_first_read() -> None:
    env, twin = RimlessWheelEnv(), RimlessWheelEnv()
    for each in (env, twin):
        each.reset(seed=0)
    whole = dict(twin.step(np.ones(1, np.float32))[-1])
    state = env.get_state()

    def fresh() -> dict:
        env.set_state(state)
        return env.step(np.ones(1, np.float32))[-1]

    assert len(whole) > 20
    assert type(whole) is dict
    assert isinstance(fresh(), dict)
    assert fresh() == whole
    assert whole == fresh()
    assert not fresh() != whole  # noqa: SIM202  an operator of its own
    assert {**fresh()} == whole
    assert dict(**fresh()) == whole
    assert (fresh() | {"more": 1}) == (whole | {"more": 1})
    assert ({"more": 1} | fresh()) == ({"more": 1} | whole)
    for way in (copy.copy, copy.deepcopy, dict.fromkeys, list, set, len, repr, bool, sorted):
        assert way(fresh()) == way(whole)
    assert json.loads(json.dumps(fresh())) == json.loads(json.dumps(whole))
    assert json.dumps(fresh(), indent=1, sort_keys=True) == json.dumps(
        whole, indent=1, sort_keys=True
    )
    assert type(fresh())(fresh()) == whole
    assert pickle.loads(pickle.dumps(fresh())) == whole
    assert type(pickle.loads(pickle.dumps(fresh()))) is dict
    assert list(reversed(fresh())) == list(reversed(whole))
    for method in ("keys", "values", "items"):
        assert list(getattr(fresh(), method)()) == list(getattr(whole, method)())
    assert fresh().copy() == whole
    for name, value in whole.items():
        assert fresh()[name] == value
        assert fresh().get(name) == value
        assert fresh().pop(name) == value
        assert fresh().setdefault(name, "other") == value
        assert name in fresh()
        info = fresh()
        info[name] = "mine"  # what is written stays
        assert info[name] == "mine"
        assert len(info) == len(whole)
        assert info == whole | {name: "mine"}
        info = fresh()
        del info[name]
        assert name not in info
        assert len(info) == len(whole) - 1
    info = fresh()
    info.update(distance=3, other=4)
    assert info == whole | {"distance": 3, "other": 4}
    info = fresh()
    info |= {"distance": 3}
    assert info == whole | {"distance": 3}
    assert "nothing" not in fresh()
    assert fresh().get("nothing") is None
    assert fresh().get("nothing", 1) == 1
    with pytest.raises(KeyError, match="nothing"):
        fresh()["nothing"]
    info = fresh()
    info.clear()
    assert info == {}
    older = fresh()
    env.step(-np.ones(1, np.float32))
    assert older == whole  # a later step leaves it alone


@pytest.mark.parametrize("settings", [{}, ROUGH], ids=["plain", "rough"])
def test_every_reset_and_step_has_the_same_entries_each_of_one_type(settings: dict) -> None:
    env, kinds, failures = gym.make("RimlessWheel-v0", **settings), set(), set()

    def see(info: dict[str, Any]) -> None:
        kinds.add(tuple(sorted((name, type(value)) for name, value in info.items())))

    see(env.reset(seed=0)[1])
    for action in swinging(1, 2000)[:, 0]:
        *_, terminated, truncated, info = env.step(action)
        see(info)
        failures.add(info["failure"])
        assert bool(info["failure"]) == terminated
        if terminated or truncated:
            see(env.reset()[1])
    assert len(kinds) == 1
    assert {kind for _, kind in kinds.pop()} == {float, int, bool}
    assert failures >= {Failure.NONE, Failure.CONTACT_LOST}


@pytest.mark.parametrize("mode", [NEXT, SAME], ids=lambda mode: mode.value)
def test_every_vector_reset_and_step_has_the_same_entries_each_of_one_type(
    mode: AutoresetMode,
) -> None:
    envs, kinds, lasts = make(3, mode), set(), 0

    def see(info: dict[str, Any]) -> None:
        kinds.add(tuple(sorted((name, each.dtype, each.shape) for name, each in info.items())))

    see(envs.reset(seed=0)[1])
    for actions in swinging(3, 400):
        info = envs.step(actions)[-1]
        final = {name: info.pop(name) for name in list(info) if "final" in name}
        see(info)
        if final:
            lasts += 1
            see(final["final_info"])
            assert final["final_info"]["failure"][final["_final_info"]].all()
    assert len(kinds) == 1
    assert (lasts > 0) == (mode is SAME)


def test_after_a_reset_every_entry_is_0_except_the_mode() -> None:
    env, envs = gym.make("RimlessWheel-v0"), make(2)
    for options, mode in (
        ({"mode": "double_stance"}, DOUBLE),
        ({"state": [1.5, 0.0, 1.0, 0.0]}, SINGLE),
    ):
        _, info = env.reset(options=options)
        assert info.pop("mode") == mode
        assert not any(info.values())
        _, info = envs.reset(options=options)
        assert info.pop("mode").tolist() == [mode, mode]
        assert not any(values.any() for values in info.values())


@pytest.mark.parametrize("name", ["jax", "minari"])
def test_info_is_a_plain_dictionary_where_jax_or_minari_is_imported(
    name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    for imported in ("jax", "minari"):  # by other tests
        monkeypatch.delitem(sys.modules, imported, raising=False)
    env, twin = RimlessWheelEnv(), RimlessWheelEnv()
    twin.reset(seed=0)
    monkeypatch.setitem(sys.modules, name, types.ModuleType(name))
    env.reset(seed=0)
    plain, lazy = (each.step(np.ones(1, np.float32))[-1] for each in (env, twin))
    assert type(plain) is dict
    assert type(lazy) is not dict
    assert plain == lazy
