"""Forces without an equation: a network or a Gaussian process on top of the physics."""
import jax as _jax

_jax.config.update("jax_enable_x64", True)
