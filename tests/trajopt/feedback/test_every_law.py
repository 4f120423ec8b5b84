from __future__ import annotations

import numpy as np
import pytest

from rimless_gym.energy import ROW
from trajopt.feedback import laws

MARKS = {name: [pytest.mark.slow] for name in laws.SLOW}


@pytest.mark.parametrize(
    "name", [pytest.param(name, marks=MARKS.get(name, [])) for name in laws.names()]
)
def test_every_law_in_the_folder_holds_its_gait(name, held, walk):
    law = laws.holding(name, held)
    totals, _ = walk(law, held.state(np.linspace(0.05, 0.85, 4)), 8.0)
    assert totals[:, ROW.steps].min() >= 4
