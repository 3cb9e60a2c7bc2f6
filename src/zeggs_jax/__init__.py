"""zeggs-jax: co-speech gesture generation in JAX. Speech in, a moving body out, in a style you choose."""

from zeggs_jax.motion.bvh import Clip
from zeggs_jax.motion.bvh import read as read_bvh
from zeggs_jax.motion.bvh import write as write_bvh
from zeggs_jax.zeroeggs import library, style_space, timeline
from zeggs_jax.zeroeggs.checkpoints import load_model, save_model
from zeggs_jax.zeroeggs.examples import bundled as bundled_styles
from zeggs_jax.zeroeggs.generate import (
    Gesture,
    Request,
    bundled_model,
    bundled_speech,
    generate,
    save,
)
from zeggs_jax.zeroeggs.model import Model, ZeroEggsConfig

__all__ = [
    "Clip",
    "Gesture",
    "Model",
    "Request",
    "ZeroEggsConfig",
    "bundled_model",
    "bundled_speech",
    "bundled_styles",
    "generate",
    "library",
    "load_model",
    "read_bvh",
    "save",
    "save_model",
    "style_space",
    "timeline",
    "write_bvh",
]
