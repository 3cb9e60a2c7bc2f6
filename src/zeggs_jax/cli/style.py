"""Commands on styles: embed, styles."""

from pathlib import Path

from tyro.conf import Positional

from .arguments import Out, Ranges
from .guards import frame_range, prepare_folder, stem


def embed(
    clips: Positional[tuple[str, ...]], /, *, out: Out, frames: Ranges = (), checkpoint: Path | None = None
) -> None:
    """Encode style clips and save their embeddings, to generate from later.

    Args:
        clips: Bundled styles or .bvh clips.
        out: The .npz file to write (for several clips: the folder).
        frames: Cut the clips to frames A to B (B not included); one for each clip, or one for all.
        checkpoint: A model of your own, from 'zeggs train' or 'zeggs convert'.
    """
    from ..zeroeggs import examples
    from ..zeroeggs import generate as g

    model = g.load_model(checkpoint) if checkpoint else g.bundled_model()
    request = g.Request(styles=clips, frames=tuple(frame_range(text) for text in frames))
    paths = [out] if len(clips) == 1 else [out / f"{stem(clip)}.npz" for clip in clips]
    for path, example in zip(paths, g.read_styles(request, model), strict=True):
        prepare_folder(path.parent)
        examples.save(path, example, model)
        print(f"wrote {path}")


def styles() -> None:
    """List the bundled styles."""
    from ..zeroeggs import examples

    print("\n".join(examples.bundled()))
