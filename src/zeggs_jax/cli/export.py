"""`zeggs export`: the step of one frame for engines that know no JAX."""

from pathlib import Path

from .guards import keep_inputs, prepare_folder


def export(
    *,
    stablehlo: Path | None = None,
    onnx: Path | None = None,
    style: str = "neutral",
    first_pose: Path | None = None,
    temperature: float = 1.0,
    seed: int = 1234,
    checkpoint: Path | None = None,
) -> None:
    """Write a model's one-frame step for other runtimes, with a description of its inputs, outputs and start.

    Args:
        stablehlo: The StableHLO file to write (portable bytecode), such as step.mlirbc.
        onnx: The ONNX file to write, such as step.onnx; needs the extra 'onnx'.
        style: The style that the description starts with; an engine may give any other.
        first_pose: A .bvh whose first frame the body starts from.
        temperature: 0 gives the mean of the style.
        seed: The same seed gives the same style.
        checkpoint: A model of your own, from 'zeggs train' or 'zeggs convert'.
    """
    outputs = tuple(filter(None, (stablehlo, onnx)))
    if not outputs:
        raise ValueError("nothing is to be written; give --stablehlo FILE, --onnx FILE, or both.")
    if any(path.suffix == ".json" for path in outputs):
        raise ValueError("a name that ends in .json is that of the description; give .mlirbc or .onnx.")
    keep_inputs(outputs, tuple(map(str, filter(None, (style, first_pose)))))
    for path in outputs:
        prepare_folder(path.parent)
    from ..zeroeggs import export as e
    from ..zeroeggs import generate as g

    model = g.load_model(checkpoint) if checkpoint else g.bundled_model()
    pose = None if first_pose is None else str(first_pose)
    made = e.step(model, g.Request(styles=(style,), first_pose=pose, temperature=temperature, seed=seed))
    for path, spell in ((stablehlo, e.stablehlo), (onnx, e.onnx)):
        if path is not None:
            print(f"wrote {path} and {e.write(path, spell(made), made, model)}")
