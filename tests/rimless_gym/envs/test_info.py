"""The single environment's info, filled in when it is first read."""

from __future__ import annotations

import copy
import json
import pickle

import numpy as np
import pytest

from rimless_gym.envs.env import RimlessWheelEnv


def test_info_is_a_dictionary_whichever_way_it_is_read_first() -> None:
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
