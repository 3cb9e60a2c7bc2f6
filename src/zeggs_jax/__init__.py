"""zeggs-jax: co-speech gesture generation in JAX. Speech in, a moving body out, in a style you choose.

Each name is imported when it is first used, so that `zeggs --help` need not wait for JAX.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
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

_PLACES = {  # module: its names, or (name there, name here)
    "motion.bvh": ("Clip", ("read", "read_bvh"), ("write", "write_bvh")),
    "zeroeggs": ("library", "style_space", "timeline"),
    "zeroeggs.checkpoints": ("load_model", "save_model"),
    "zeroeggs.examples": (("bundled", "bundled_styles"),),
    "zeroeggs.generate": ("Gesture", "Request", "bundled_model", "bundled_speech", "generate", "save"),
    "zeroeggs.model": ("Model", "ZeroEggsConfig"),
}


if not TYPE_CHECKING:  # editors and type checkers know the names above, and see what is misspelt

    def __getattr__(name: str) -> Any:
        for place, names in _PLACES.items():
            for there, here in ((n, n) if isinstance(n, str) else n for n in names):
                if here == name:
                    module = import_module(f"zeggs_jax.{place}")
                    return getattr(module, there, None) or import_module(f"zeggs_jax.{place}.{there}")
        raise AttributeError(f"module 'zeggs_jax' has no attribute '{name}'")


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
