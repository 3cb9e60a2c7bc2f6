"""Video files as prompts, and rendered motions as video files, through PyAV (extra `video`)."""

import itertools
import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float, Float32, UInt8
from numpy import ndarray

LONGEST_S = 60.0  # what comes later in a video is not read
STRETCH_S = 6.0  # what one prompt is made of; a longer video is several
PICTURES_HZ = 8.0  # pictures of a second that are looked at


def read(path: str | Path, frames: int, pixels: int) -> Float32[ndarray, "K V H W 3"]:
    """A video's pictures, 0 to 1: K stretches of about 6 s, `frames` pictures evenly from each, `pixels` high and wide.

    Of a picture wider than high the middle is taken; one higher than wide gets margins in the colour of its edges. A
    minute at most is read.

    Raises:
        FileNotFoundError: no such file.
        ValueError: PyAV is not installed, or the file is no video that it decodes.
    """
    av = _package()
    if not Path(path).is_file():
        raise FileNotFoundError(f"there is no video '{path}'; check its name.")
    pictures: list[UInt8[ndarray, "H W 3"]] = []
    with _told(av, f"'{path}' is no video that can be decoded"), av.open(str(path)) as container:
        if not container.streams.video:
            raise ValueError(f"'{path}' has no pictures; give a video with a moving person in it.")
        for count, frame in enumerate(container.decode(video=0)):
            time = count / PICTURES_HZ if frame.time is None else frame.time
            if time > LONGEST_S:
                break
            if time * PICTURES_HZ >= len(pictures):
                pictures.append(_square(frame, pixels))
    if not pictures:
        raise ValueError(f"'{path}' has no picture that can be decoded; save it again as MP4 (H.264).")
    stretches = max(1, round(len(pictures) / (STRETCH_S * PICTURES_HZ)))
    spans = itertools.pairwise(np.linspace(0, len(pictures), stretches + 1).tolist())
    places = [np.linspace(start, max(stop - 1.0, start), frames) for start, stop in spans]
    chosen = np.clip(np.round(places).astype(int), 0, len(pictures) - 1)
    return np.stack(pictures)[chosen].astype(np.float32) / 255.0


def write(path: str | Path, images: Float[ndarray, "V H W 3"], fps: float | int) -> None:
    """Pictures, 0 to 1, as an MP4 (H.264); their height and width are even.

    Raises:
        ValueError: PyAV is not installed, or an odd size.
        OSError: the file cannot be written.
    """
    av, path = _package(), Path(path)
    height, width = images.shape[1:3]
    if height % 2 or width % 2:
        raise ValueError(f"pictures of {width} x {height} pixels cannot be an MP4; give even sizes.")
    partial = path.with_name(f".{path.name}.partial")
    try:
        with av.open(str(partial), "w", format="mp4") as container:
            stream = container.add_stream("libx264", rate=round(fps))
            stream.width, stream.height, stream.pix_fmt = width, height, "yuv420p"
            for image in images:
                pixels = np.round(np.clip(image, 0.0, 1.0) * 255.0).astype(np.uint8)
                container.mux(stream.encode(av.VideoFrame.from_ndarray(pixels, format="rgb24")))
            container.mux(stream.encode())
        os.replace(partial, path)
    finally:
        partial.unlink(missing_ok=True)


def _square(frame: Any, pixels: int) -> UInt8[ndarray, "H W 3"]:
    """One picture as the encoder sees it."""
    quarter_turns = round(getattr(frame, "rotation", 0) / 90)
    high, wide = (frame.width, frame.height) if quarter_turns % 2 else (frame.height, frame.width)
    width = max(1, round(pixels * wide / high))
    sizes = {"width": pixels, "height": width} if quarter_turns % 2 else {"width": width, "height": pixels}
    picture = np.rot90(frame.reformat(**sizes, format="rgb24", interpolation="AREA").to_ndarray(), quarter_turns)
    if width >= pixels:
        left = (width - pixels) // 2
        return np.ascontiguousarray(picture[:, left : left + pixels])
    edges = picture[:, [0, -1]].reshape(-1, 3).mean(axis=0).astype(np.uint8)
    square = np.broadcast_to(edges, (pixels, pixels, 3)).copy()
    left = (pixels - width) // 2
    square[:, left : left + width] = picture
    return square


def _package() -> Any:
    try:
        import av
    except ImportError as error:
        raise ValueError("video prompts need the package 'av': pip install 'zeggs-jax[video]'.") from error
    return av


@contextmanager
def _told(av: Any, what: str) -> Iterator[None]:
    """PyAV's errors in one sentence."""
    try:
        yield
    except av.error.FFmpegError as error:
        raise ValueError(f"{what} ({error.strerror}); save it again as MP4 (H.264).") from error
