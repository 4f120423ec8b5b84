"""Evaluates a policy that rl-zoo3 trained on `RimlessWheel-v0`: rl_zoo3_evaluated.py ALGO FILE.

It is evaluated by the protocol of all tables of docs/learning.md, where it decides every 10 ms.
"""

from __future__ import annotations

import sys
from typing import Any

import stable_baselines3

from agents.evaluate import evaluate
from agents.rollout import learned_policy

if __name__ == "__main__":
    algo, file = sys.argv[1:]
    model = getattr(stable_baselines3, algo.upper()).load(file, device="cpu")

    def actions(observations: Any) -> Any:
        return model.predict(observations, deterministic=True)[0][:, 0].astype(float)

    walks = evaluate(learned_policy(actions), progress=True)
    print(
        f"{100 * walks.walking_share:.0f} % walk, CoT {walks.cot:.4f} at {walks.speed:.3f} m/s; "
        f"the others: {walks.failures}"
    )
