"""Saved gaits: what is refused on loading, and whether the shipped ones pass verification."""

from __future__ import annotations

import json
import math

import numpy as np
import pytest

from rimless_gym import THESIS_PHYSICAL
from trajopt import NoGaitError, Solution, periodic_gait
from trajopt.files import DIGEST, HEADER, digest
from trajopt.gaits.library import FOLDER, shipped
from trajopt.gaits.solution import FORMAT, GaitFileError
from trajopt.gaits.verify import verify

SHIPPED = sorted(path.name for path in FOLDER.glob("*.npz"))


@pytest.fixture
def path(tmp_path):
    """A copy of a shipped gait."""
    copy = tmp_path / "gait.npz"
    copy.write_bytes((FOLDER / SHIPPED[0]).read_bytes())
    return copy


def rewrite(path, signed=False, header=None, **arrays):
    """Change a file's arrays (None: leave out) or header; `signed` with a digest that fits."""
    with np.load(path) as data:
        content = {name: data[name] for name in data.files} | arrays
    content = {name: array for name, array in content.items() if array is not None}
    if header is not None:
        changed = header(json.loads(str(content[HEADER])))
        content[HEADER] = np.array(changed if isinstance(changed, str) else json.dumps(changed))
    if signed:
        del content[DIGEST]
        content[DIGEST] = np.array(digest(content))
    np.savez_compressed(path, **content)


def heavier(header):
    return header | {"params": header["params"] | {"wheel_mass": 3.0}}


def whitewashed(header):
    return header | {"verification": header["verification"] | {"peak_voltage": 1.0}}


def shifted(path):
    with np.load(path) as data:
        return {"phase0_states": data["phase0_states"] + 1e-9}


def refused(path, match):
    with pytest.raises(GaitFileError, match=rf"(?s){path.name}: .*{match}.*again"):
        Solution.load(path)


def test_a_shipped_gait_saved_again_is_the_same(path):
    first = Solution.load(path)
    first.save(path)
    second = Solution.load(path)
    assert second.to_dict() == first.to_dict()
    t = np.linspace(0, first.duration, 50)
    np.testing.assert_array_equal(second.state(t), first.state(t))


def test_edited_parameters_verdicts_or_states_are_refused(path):
    content = path.read_bytes()
    for header in (heavier, whitewashed):
        rewrite(path, header=header)
        refused(path, "edited or damaged")
        path.write_bytes(content)
    rewrite(path, **shifted(path))
    refused(path, "edited or damaged")
    path.write_bytes(content)
    rewrite(path)  # nothing changed but the compression
    assert Solution.load(path).verification.passed


def test_a_gait_without_a_digest_is_refused(path):
    rewrite(path, **{DIGEST: None})
    refused(path, "edited or damaged")


def test_a_gait_of_an_earlier_format_is_refused_by_name(path):
    rewrite(path, header=lambda h: h | {"format": "rimless-gym gait 1"})
    refused(path, f"gait 1.*{FORMAT}")


@pytest.mark.parametrize("name", ["phase0_states", "phase0_controls", "phase0_edges"])
def test_a_gait_that_is_not_finite_is_refused(path, name):
    with np.load(path) as data:
        array = data[name].copy()
    array.flat[-1] = np.nan
    rewrite(path, signed=True, **{name: array})
    refused(path, f"{name[7:]}: must all be finite")


@pytest.mark.parametrize(
    "change",
    [
        lambda h: {key: value for key, value in h.items() if key != "verification"},
        lambda h: h | {"verification": None},
        lambda h: h | {"params": {"wheel_mass": -1}},
        lambda h: h | {"optima": [3]},
    ],
)
def test_a_header_with_parts_missing_or_wrong_is_refused(path, change):
    rewrite(path, signed=True, header=change)
    refused(path, "no valid gait")


@pytest.mark.parametrize("text", ["", "[]", "null", "3", "{}", "not JSON", "\ud7ff"])
def test_a_header_that_is_not_an_object_is_refused(path, text):
    rewrite(path, signed=True, header=lambda _: text)
    refused(path, "not a file of format 'rimless-gym gait")


ARRAYS = ["edges", "nodes", "states", "control_nodes", "controls"]
CHANGES = {
    "cut short": lambda a: a[:-1],
    "empty": lambda a: a[:0],
    "with one more": lambda a: np.concatenate([a, a[-1:]]),
    "of another shape": lambda a: a.reshape(len(a), -1, 1, 1),
    "a number": lambda a: a.ravel()[0],
    "of less precision": lambda a: a.astype(np.float32),
    "of integers": lambda a: a.astype(np.int64),
    "complex": lambda a: a.astype(complex),
    "text": lambda a: a.astype(str),
    "not a number": lambda a: np.where(np.arange(a.size).reshape(a.shape) == 1, np.nan, a),
    "missing": lambda a: None,
}


@pytest.mark.parametrize("change", CHANGES)
@pytest.mark.parametrize("name", ARRAYS)
def test_arrays_that_do_not_fit_are_refused_by_name_even_if_signed(path, name, change):
    with np.load(path) as data:
        changed = CHANGES[change](data[f"phase0_{name}"])
    rewrite(path, signed=True, **{f"phase0_{name}": changed})
    missing = (name, change) == ("edges", "missing")
    refused(path, "no phases" if missing else r"phase0.*(shape|type|finite|missing|increase|end)")


def test_a_stride_with_its_last_element_cut_off_is_refused(path):
    with np.load(path) as data:
        cut = {f"phase0_{name}": data[f"phase0_{name}"][:-1] for name in ("edges", "states")}
        cut["phase0_controls"] = data["phase0_controls"][:-1]
    rewrite(path, signed=True, **cut)
    refused(path, "its time is .* was verified")


def test_states_that_jump_and_unknown_arrays_are_refused(path):
    content = path.read_bytes()
    with np.load(path) as data:
        swapped = data["phase0_states"][::-1]
    rewrite(path, signed=True, phase0_states=swapped)
    refused(path, "jump between elements")
    path.write_bytes(content)
    rewrite(path, signed=True, phase7_edges=np.linspace(0.0, 1.0, 3))
    refused(path, "phase7_edges: no such arrays are known")


def test_a_gait_without_phases_is_refused(path):
    with np.load(path) as data:
        none = {name: None for name in data.files if name.startswith("phase")}
    rewrite(path, signed=True, **none)
    refused(path, "no phases")


def test_damage_anywhere_is_refused_or_harmless(path):
    whole, gait = path.read_bytes(), Solution.load(path)
    rng = np.random.default_rng(0)
    refusals = 0
    for position in rng.integers(0, len(whole), 150):
        content = bytearray(whole)
        content[position] ^= 1 << int(rng.integers(8))
        path.write_bytes(content)
        try:
            assert Solution.load(path).to_dict() == gait.to_dict()
        except GaitFileError:
            refusals += 1
    assert refusals > 100
    for length in rng.integers(0, len(whole), 20):
        path.write_bytes(whole[:length])
        refused(path, "not a file of format 'rimless-gym gait")


def test_a_folder_and_a_bare_array_are_refused(tmp_path):
    with pytest.raises(GaitFileError, match="a folder"):
        Solution.load(tmp_path)
    with (tmp_path / "array.npz").open("wb") as file:
        np.save(file, np.zeros(3))
    refused(tmp_path / "array.npz", "not a file of format 'rimless-gym gait")


# -- shipped gaits, from scratch ------------------------------------------------------------------


def check_from_scratch(name):
    gait = Solution.load(FOLDER / name)
    found = verify(gait.params, gait.phases, gait.theta_turns)
    assert found.failures == gait.verification.failures == ()
    assert found.state_error < 1e-6
    sums, extremes = ("electrical_positive", "electrical"), ("min_normal_force", "clearance")
    # Extremes are sampled. Those in the files were sampled only at the ends of the simulator's
    # steps, at other times than today's. That alone changes a clearance by up to 3.8e-4 m.
    for figure in (*sums, *extremes):
        stored = getattr(gait.verification, figure)
        close = pytest.approx(stored, rel=1e-5 if figure in sums else 2e-3, abs=1e-6)
        assert getattr(found, figure) == close, figure


@pytest.mark.parametrize(
    "name", ["thesis_physical_1_steps_k-1_0.5000.npz", "thesis_physical_2_steps_k0_0.5000.npz"]
)
def test_the_shipped_gaits_at_half_a_metre_per_second_pass_verification_again(name):
    check_from_scratch(name)


@pytest.mark.slow
@pytest.mark.parametrize("name", SHIPPED)
def test_every_shipped_gait_passes_verification_again(name):
    check_from_scratch(name)


def test_verification_fails_on_a_changed_machine():
    gait = next(s for s in shipped() if s.steps == 1 and abs(s.speed - 0.5) < 1e-9)
    other = gait.params.replace(wheel_mass=1.01 * gait.params.wheel_mass)
    assert not verify(other, gait.phases, gait.theta_turns).passed


# -- arguments of the search ----------------------------------------------------------------------


@pytest.mark.parametrize(
    ("arguments", "error", "message"),
    [
        ({"speed": True}, TypeError, "speed = True"),
        ({"speed": "fast"}, TypeError, "speed = 'fast'"),
        ({"steps": math.nan}, TypeError, "steps = nan: must be an integer of at least 1"),
        ({"steps": 1.5}, TypeError, r"steps = 1\.5: must be an integer of at least 1"),
        ({"steps": 0}, ValueError, "steps = 0: must be an integer of at least 1"),
        ({"steps": None}, TypeError, "steps = None"),
        ({"steps": True}, TypeError, "steps = True"),
        ({"starts": -1}, ValueError, "starts = -1: must be an integer of at least 0"),
        ({"starts": math.inf}, TypeError, "starts = inf"),
        ({"starts": "many"}, TypeError, "starts = 'many'"),
        ({"guess": "x"}, TypeError, "guess = 'x'.*Solution"),
        ({"params": None}, TypeError, "params = None.*WheelParams"),
        ({"speed": 1e6}, NoGaitError, r"speed = 1000000.0: must be at most 21.05 m/s.*60 rad/s"),
        ({"speed": 23}, NoGaitError, r"speed = 23\.0: must be at most 21.05 m/s"),
        ({"steps": 10**9}, NoGaitError, "steps = 1000000000: must be at most 25.*shorter stride"),
        ({"seed": -1}, ValueError, "seed = -1"),
        ({"workers": 0}, ValueError, "workers = 0"),
        ({"workers": 1.5}, TypeError, "workers = 1.5"),
        ({"regeneration": "yes"}, TypeError, "regeneration = 'yes': must be True or False"),
        ({"progress": 1}, TypeError, "progress = 1: must be True or False"),
    ],
)
def test_invalid_arguments_are_refused_by_name(arguments, error, message):
    with pytest.raises(error, match=message):
        periodic_gait(**({"params": THESIS_PHYSICAL} | arguments))


def test_numpy_numbers_are_accepted_as_arguments():
    one = next(s for s in shipped() if s.steps == 1 and abs(s.speed - 0.5) < 1e-9)
    gait = periodic_gait(
        THESIS_PHYSICAL, np.float32(0.5), np.int8(1), guess=one, starts=np.int64(0)
    )
    assert gait.verification.passed
    assert (gait.speed, gait.steps) == (pytest.approx(0.5, abs=1e-12), 1)
    json.dumps(gait.provenance)
