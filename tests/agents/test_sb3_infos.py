"""Sb3VecEnv's infos, filled in when they are first read."""

import copy
import json
import pickle

import numpy as np
import pytest

from tests.agents.sb3_rows import assert_same, both, whirling

#: Ways to read a dictionary that has these entries.
READERS = {
    "dict": lambda info, names: dict(info),
    "unpacking": lambda info, names: {**info},
    "keywords": lambda info, names: (lambda **entries: entries)(**info),
    "update": lambda info, names: (entries := {}, entries.update(info))[0],
    "or": lambda info, names: info | {},
    "or from the right": lambda info, names: {} | info,
    "copy": lambda info, names: info.copy(),
    "copy.copy": lambda info, names: copy.copy(info),
    "copy.deepcopy": lambda info, names: copy.deepcopy(info),
    "pickle": lambda info, names: pickle.loads(pickle.dumps(info)),
    "json": lambda info, names: json.loads(json.dumps(info)),
    "repr": lambda info, names: eval(repr(info), {"inf": np.inf}),
    "iteration": lambda info, names: {name: info[name] for name in info},
    "reversed": lambda info, names: {name: info[name] for name in reversed(info)},
    "items": lambda info, names: dict(info.items()),
    "keys, values": lambda info, names: dict(zip(info.keys(), info.values(), strict=True)),
    "brackets": lambda info, names: {name: info[name] for name in names},
    "get": lambda info, names: {name: info.get(name, "none") for name in names},
    "setdefault": lambda info, names: {name: info.setdefault(name, "none") for name in names},
    "in": lambda info, names: {name: info[name] for name in names if name in info},
    "pop": lambda info, names: {name: info.pop(name) for name in names},
    "popitem": lambda info, names: dict(info.popitem() for _ in range(len(info))),
}


@pytest.fixture
def unread():
    """The info of a row that has not been read yet, and what it should hold."""
    ours, theirs = both(2)
    for env in (ours, theirs):
        env.reset()
    actions = whirling(2, 0)
    return ours.step(actions)[3][1], theirs.step(actions)[3][1]


@pytest.mark.parametrize("reader", READERS)
def test_every_way_of_reading_an_unread_info_gives_all_its_entries(unread, reader):
    info, wanted = unread
    got = READERS[reader](info, list(wanted))
    assert got == wanted
    assert type(got) is dict


def test_an_unread_info_equals_what_it_should_hold(unread):
    info, wanted = unread
    assert (info != {}, info != wanted) == (True, False)
    assert wanted == info
    assert len(info) == len(wanted)
    assert isinstance(info, dict)


def test_an_info_keeps_what_is_written_and_lacks_every_other_name(unread):
    info, wanted = unread
    info["distance"], info["mine"] = "other", 1
    assert info == wanted | {"distance": "other", "mine": 1}
    del info["distance"]
    assert "distance" not in info
    assert info.get("nothing") is None
    assert "nothing" not in info
    with pytest.raises(KeyError, match="nothing"):
        info["nothing"]


def test_an_info_read_late_is_still_that_of_its_step():
    ours, theirs = both(3)
    for env in (ours, theirs):
        env.reset()
    steps = [(ours.step(whirling(3, k))[3], theirs.step(whirling(3, k))[3]) for k in range(90)]
    for mine, yours in steps:
        for info, wanted in zip(mine, yours, strict=True):
            assert_same(info, wanted)
