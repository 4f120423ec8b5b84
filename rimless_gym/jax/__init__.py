"""The environment on accelerators, in JAX: from the same lines as the compiled one.

>>> import jax
>>> from rimless_gym.jax import WheelEnv
>>> env = WheelEnv()
>>> observation, state = env.reset(jax.random.key(0))

It has the interface of gymnax 1.x; `RejaxEnv` is what rejax takes, `brax_env` what Brax's learners
take. `import rimless_gym` does not import JAX.
"""

from rimless_gym.checks import extra

with extra("jax"):
    from rimless_gym.jax.env import EnvParams, EnvState, RejaxEnv, WheelEnv, brax_env

__all__ = ["EnvParams", "EnvState", "RejaxEnv", "WheelEnv", "brax_env"]
