"""The environment on accelerators, in JAX: from the same lines as the compiled one.

>>> import jax
>>> from rimless_gym.jax import WheelEnv, compiler_options
>>> env = WheelEnv()
>>> step = jax.jit(jax.vmap(env.step), compiler_options=compiler_options())

It has the interface of gymnax 1.x; `RejaxEnv` is what rejax takes, `brax_env` what Brax's learners
take. `import rimless_gym` does not import JAX.
"""

from rimless_gym.checks import extra

with extra("jax"):
    from rimless_gym.jax.env import EnvParams, EnvState, RejaxEnv, WheelEnv, brax_env
    from rimless_gym.jax.interval import compiler_options

__all__ = ["EnvParams", "EnvState", "RejaxEnv", "WheelEnv", "brax_env", "compiler_options"]
