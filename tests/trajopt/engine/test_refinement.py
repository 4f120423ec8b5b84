import dataclasses

import numpy as np

from trajopt import Mesh, solve
from trajopt.accuracy import assess
from trajopt.refinement import refined
from trajopt.textbook import least_effort_move


def test_an_infinite_error_is_refined_like_a_large_one():
    problem = least_effort_move()
    mesh = Mesh.uniform(problem, 3)
    rough = solve(problem, mesh=mesh, passes=0, verify=False)
    quality = assess(problem.phases[0], rough.phases[0], rough.parameters)
    hopeless = dataclasses.replace(quality, step_error=np.array([0.0, np.inf, 0.0]))
    arguments = (mesh, problem, rough.phases, rough.parameters)
    finer = refined(*arguments, [hopeless], 1e-7, 1e-6, 1e-6)
    assert finer.elements > mesh.elements or max(finer.degrees[0]) > 4
