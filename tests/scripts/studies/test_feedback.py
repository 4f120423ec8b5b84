"""The study of feedback laws: what it measures and what it writes."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from rimless_gym import BUILDABLE, RimlessWheelVectorEnv
from rimless_gym.kernel.stepping import STATE_SIZE, advance
from scripts.studies.feedback_laws import command, drawing
from scripts.studies.feedback_laws.columns import COLUMNS, TIMING
from scripts.studies.feedback_laws.columns.changes import changed_machines
from scripts.studies.feedback_laws.columns.multipliers import Stride
from scripts.studies.feedback_laws.columns.pushes import Survived, pushed_states
from scripts.studies.feedback_laws.gaits import GAITS
from scripts.studies.feedback_laws.sizes import sizes_for
from trajopt.feedback.law import Floats
from trajopt.gaits.library import shipped
from trajopt.gaits.solution import Solution

DOCS = Path(__file__).parents[3] / "docs"
HELD = GAITS[2]


@pytest.fixture(scope="module")
def gait() -> Solution:
    return next(each for each in shipped() if each.params == BUILDABLE and each.steps == 1)


# -- what is measured -----------------------------------------------------------------------------


@pytest.mark.slow
def test_a_trial_measures_every_column_and_the_law_holds_its_gait(measured: dict[str, Any]) -> None:
    row = measured["results"][HELD.key]["lqr"]
    assert measured["errors"] == {}
    assert set(row) == set(COLUMNS)
    assert row["slopes"]["tried"]["0"]["share"] == 1.0
    assert 0 < row[TIMING]["batch"] < row[TIMING]["single"]
    assert row["attraction"]["states"] == len(row["attraction"]["walking"])


@pytest.mark.slow
def test_small_deviations_decay_by_the_largest_multiplier(measured: dict[str, Any]) -> None:
    found = measured["results"][HELD.key]["lqr"]["multipliers"]
    assert found["open_loop"][0] > 1.0 > found["closed_loop"][0]
    assert found["decay"] == pytest.approx(found["closed_loop"][0], rel=0.2)


class Jumping(Stride):
    """Halves every deviation, but jumps for those of about one of the central differences."""

    def __call__(self, states: Floats) -> Floats:
        jumps = (states > 3e-6) & (states < 3e-5)
        return np.asarray(0.5 * states + 1e-5 * jumps)


def test_a_jump_within_one_of_the_central_differences_is_no_multiplier(gait: Solution) -> None:
    stride = Jumping(gait, lambda x, tick: np.zeros(len(x)), np.ones(4))
    assert stride.jacobian(np.zeros(4)) == pytest.approx(0.5 * np.eye(4), abs=1e-9)


def test_a_push_is_that_of_the_environment() -> None:
    c, impulse = BUILDABLE.constants, 0.3
    x = np.zeros((1, STATE_SIZE))
    x[0, :4] = [0.5 * (c.a + c.b), 0.4, 1.0, -2.0]
    envs = RimlessWheelVectorEnv(
        1, BUILDABLE, disturbances={"pushes": {"rate": 1e9, "impulse": (impulse, impulse)}}
    )
    envs.reset(seed=0, options={"state": x[:, :4], "mode": "single_stance"})
    envs.step(np.zeros((1, 1), np.float32))
    ends = []
    for sign in (1.0, -1.0):
        pushed = pushed_states(BUILDABLE, x, np.array([sign * impulse]))
        advance(BUILDABLE, pushed, np.zeros(1))
        ends.append(np.allclose(pushed[:, :4], envs.states[:, :4], rtol=1e-12))
    assert sum(ends) == 1


@pytest.mark.slow
def test_a_wheel_that_walks_again_after_a_push_takes_steps_again(measured: dict[str, Any]) -> None:
    found = measured["results"][HELD.key]["lqr"]["pushes"]
    for side in ("backward", "forward"):
        walking, stepping = (np.array(found[f"{side}_{kind}"]) for kind in ("walking", "stepping"))
        assert (walking <= stepping).all()


def test_every_parameter_of_the_machine_is_changed_up_and_down_by_itself() -> None:
    found = list(changed_machines(BUILDABLE))
    assert {name for name, _, _ in found} > {"pendulum_length", "motor_constant", "gear_loss"}
    for name, change, params in found:
        assert getattr(params, name) == pytest.approx((1 + change) * getattr(BUILDABLE, name))
        others = {k for k, v in params.to_dict().items() if v != BUILDABLE.to_dict()[k]}
        assert others <= {name, "pendulum_reach"}


def test_a_slow_law_is_measured_from_fewer_starts() -> None:
    assert sizes_for(slow=True, quick=False).starts < sizes_for(slow=False, quick=False).starts


# -- what is written ------------------------------------------------------------------------------


@pytest.mark.slow
def test_there_are_two_pictures_of_every_gait(measured: dict[str, Any]) -> None:
    drawn = drawing.figures(measured)
    assert set(drawn) == {drawing.attraction_file(HELD.key), drawing.pushes_file(HELD.key)}
    assert all(figure.axes for figure in drawn.values())


def test_the_pictures_call_the_laws_by_words() -> None:
    caught = {"rates": [[1.0, 2.0], [0.0, 1.0]], "walking": [True, False], "times": [0.5, None]}
    kinds = [f"{side}_{kind}" for side in ("forward", "backward") for kind in Survived._fields]
    pushes = {"phases": [0.25, 0.75]} | {kind: [1.0, 2.0] for kind in kinds}
    row = {"attraction": caught, "pushes": pushes}
    found = {"results": {HELD.key: {"sliding_mode": row, "lqr": row}}}
    states, pushed = drawing.figures(found).values()
    assert [axes.get_title() for axes in states.axes[:2]] == ["sliding mode", "LQR"]
    legend = pushed.axes[0].get_legend()
    assert legend is not None
    assert [text.get_text() for text in legend.get_texts()] == ["sliding mode", "LQR"]


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--laws", "lqr,lqg"], "'lqg': choose from"),
        (["--gaits", "buildable_0.7"], "'buildable_0.7': choose from buildable_0.5"),
        (["--workers", "0"], "must be an integer of at least 1"),
        (["--docs", "nowhere.md"], "nowhere.md: no such file"),
        (["--docs", "feedback.md", "--quick"], "leave out --docs, or --quick"),
        (["--docs", "feedback.md", "--laws", "lqr"], "leave out --docs, or --quick"),
        (["--docs", "feedback.md", "--gaits", "buildable_0.5"], "leave out --docs, or --quick"),
    ],
)
def test_arguments_that_make_no_sense_are_refused(
    arguments: list[str], message: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit) as exited:
        command.main(["--out", str(tmp_path), *arguments])
    assert exited.value.code == 2
    assert message in capsys.readouterr().err


def test_an_interruption_says_how_to_go_on(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def interrupted(*arguments: Any) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(command, "study", interrupted)
    assert command.main(["--quick", "--out", str(tmp_path)]) == command.INTERRUPTED
    assert "the same command goes on" in capsys.readouterr().err
