"""Text prompts for ZeroEGGS: GestureDiffuCLIP's prompt encoders pick and mix style clips (the idea of its MD-ZE)."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

LEAST = 0.01  # clips of a smaller weight are left out


def chosen(
    prompt: str | None, prompts_model: Path | None, styles: tuple[str, ...], weights: tuple[float, ...], others: bool
) -> tuple[tuple[str, ...], tuple[float, ...], tuple[str, ...]]:
    """(styles, their weights, notes): as given, or those that `mix` finds; `others`: they are given in another way."""
    if prompt is None:
        if prompts_model is not None:
            raise ValueError("--prompts-from was given without --prompt; say which prompt it shall read.")
        return styles, weights, ()
    if others:
        raise ValueError("--prompt mixes the styles itself; leave --weights, --spans, --frames and --timeline out.")
    mixture, notes = mix(prompt, styles, prompts_model)
    return tuple(mixture), tuple(mixture.values()), notes


def mix(prompt: str, styles: Sequence[str], prompts_model: Path | None) -> tuple[dict[str, float], tuple[str, ...]]:
    """(weights of the style clips that are near to a prompt, sum 1; what is worth knowing of the prompt).

    Args:
        prompt: words, or the path of a .bvh clip or of a video.
        styles: bundled styles or .bvh clips to choose from; all bundled ones where there are none.
        prompts_model: the GestureDiffuCLIP model that reads the prompt; the bundled one when left out.

    Raises:
        ValueError, OSError: an empty prompt, a style that is no clip, clips of another skeleton than the model's.
    """
    import numpy as np

    from ..diffuclip import generate as g
    from ..diffuclip import prompts, request
    from ..zeroeggs import examples

    bundled = examples.bundled()
    clips = {name: bundled.get(name, Path(name)) for name in styles or bundled}
    for name, path in clips.items():
        if path.suffix.lower() != ".bvh":
            raise ValueError(f"a prompt chooses among clips, and '{name}' is none; give bundled styles or .bvh files.")
    model: Any = g.load_model(prompts_model) if prompts_model else g.bundled_model()
    asked, notes = request.embed(prompt, model)
    candidates = np.stack([request.embed(str(path), model)[0] for path in clips.values()])
    weights = np.asarray(prompts.pick(asked, candidates), float)
    weights = np.where(weights < LEAST, 0.0, weights)
    weights /= weights.sum()
    found = {name: float(weight) for name, weight in zip(clips, weights, strict=True) if weight > 0}
    found = dict(sorted(found.items(), key=lambda pair: -pair[1]))
    told = ", ".join(f"{Path(name).stem} {weight:.2f}" for name, weight in found.items())
    return found, (*notes, f"the prompt '{prompt}' is a mixture of {told}")
