"""A closed loop as a film: GIF by Pillow, which comes with matplotlib; MP4 by ffmpeg.

Frames of a GIF share one palette and are not dithered, so that from frame to frame only what moved
changes, and Pillow stores little else: a mission stays far below the size of one palette a frame.
"""

import contextlib
import importlib
import shutil
import subprocess
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from fgplan.checks import check_positive
from fgplan.closed_loop.records import LoopHistory
from fgplan.errors import InvalidInputError, MissingExtraError
from fgplan.viz.loop_scene import LoopScene, Moment
from roadmaps import Workspace

_FADE = (0.25, 0.5, 0.75)
"""Opacity of the candidates in the frames before the choice is shown."""

_FAINT = 0.15
"""Opacity of the candidates while the robots move."""

_HOLD_S = 0.4
"""How long the choice is shown before the robots move, and four times as long the end."""

_GIF_FPS = 100.0
"""A frame of a GIF lasts whole hundredths of a second; zero would mean whatever a viewer takes."""

_EXACT, _BLENDED, _APART = 24, 64, 8
"""Colours of the palette that are kept exactly, those that stand for all others, and
the least difference between two."""


def animate_loop(
    history: LoopHistory,
    path: str | Path,
    *,
    workspace: Workspace | None = None,
    fps: float = 10.0,
    dpi: int = 100,
    frames: int = 100,
) -> Path:
    """Write a film of the whole mission.

    The map shows true and estimated robots, covariance ellipses, landmarks as they enter the map,
    measurements, and at each planning session the candidates and then the choice; beside it runs
    the position uncertainty of every robot.

    Args:
        history: The loop; at least one step.
        path: Ends in .gif or .mp4; its folder is made if missing.
        workspace: Bounds and obstacles; None takes the extent of all there is in the loop.
        fps: Frames a second; in a .gif at most 100, because each stands for whole hundredths of
            a second (30 become 33).
        dpi: Dots an inch of a film of 8 by 6 inches.
        frames: Longer missions show every second step, every third and so on, so that motion
            takes about so many frames; steps with a planning session are always shown.

    Returns:
        The path.

    Raises:
        InvalidInputError: If the name ends otherwise, a number is not above zero, a .gif has more
            than 100 frames a second, or there is no step.
        MissingExtraError: If matplotlib, or for .mp4 ffmpeg, is not there.
    """
    path = Path(path)
    if path.suffix not in (".gif", ".mp4"):
        raise InvalidInputError(f"film {path.name!r}: expected a name that ends in .gif or .mp4")
    check_positive(fps, "film fps")
    check_positive(dpi, "film dpi")
    check_positive(frames, "film frames")
    if path.suffix == ".gif" and fps > _GIF_FPS:
        raise InvalidInputError(f"film fps: expected at most {_GIF_FPS:g} in a .gif, got {fps!r}")
    encoder = _ffmpeg() if path.suffix == ".mp4" else ""
    scene = LoopScene(history, workspace, dpi)
    moments = film_moments(history, frames=frames, hold=max(1, round(_HOLD_S * fps)))
    path.parent.mkdir(parents=True, exist_ok=True)
    if path.suffix == ".gif":
        _write_gif(scene, moments, path, fps)
    else:
        _write_mp4(scene, moments, path, fps, encoder)
    return path


def film_moments(history: LoopHistory, *, frames: int, hold: int) -> tuple[Moment, ...]:
    """Choose what each frame shows.

    Args:
        history: The loop.
        frames: Motion takes about so many.
        hold: Frames that a choice is held; the end four times as many.

    Returns:
        Moments in order; at a session's step the candidates fade in, then the choice stands.
    """
    count = len(history.steps)
    stride = max(1, -(-count // frames))
    moments = []
    session = -1
    for place, record in enumerate(history.steps):
        held = [n for n, one in enumerate(history.sessions) if one.step == record.step]
        if held or place % stride == 0 or place == count - 1:
            moments.append(Moment(place, session, _FAINT, True, False))
        for session in held:
            moments += [Moment(place, session, opacity, False, True) for opacity in _FADE]
            moments += [Moment(place, session, _FADE[-1], True, True)] * hold
    return (*moments, *[moments[-1]] * (4 * hold))


def _frames(
    scene: LoopScene, moments: tuple[Moment, ...], drawn: dict[Moment, Any]
) -> Iterator[Any]:
    """Pixels of each moment; one that is held or in ``drawn`` is not drawn again."""
    before, pixels = None, None
    for moment in moments:
        if moment != before:
            before, pixels = moment, drawn.get(moment)
            if pixels is None:
                pixels = scene.pixels(moment)
        yield pixels


def _write_gif(scene: LoopScene, moments: tuple[Moment, ...], path: Path, fps: float) -> None:
    """Write frames with one palette made from the first, the middle and the last."""
    image = importlib.import_module("PIL.Image")
    last = len(moments) - 1
    sampled = [moments[place] for place in sorted({0, last // 2, last})]
    drawn = {moment: scene.pixels(moment) for moment in dict.fromkeys(sampled)}
    palette = _palette(image, np.concatenate([drawn[one] for one in sampled]).reshape(-1, 3))

    def quantized() -> Iterator[Any]:
        for pixels in _frames(scene, moments, drawn):
            yield image.fromarray(pixels).quantize(palette=palette, dither=image.Dither.NONE)

    rest = quantized()
    next(rest).save(
        path,
        format="GIF",
        save_all=True,
        append_images=rest,
        duration=10 * round(_GIF_FPS / fps),
        loop=0,
        optimize=False,
    )


def _palette(image: Any, pixels: Any) -> Any:  # noqa: ANN401
    """The commonest colours as they are, then those of the rest by the root of their pixels."""
    # One number a pixel: sorting rows is ten times as slow.
    red, green, blue = pixels.astype(np.uint32).T
    numbers, counts = np.unique(red << 16 | green << 8 | blue, return_counts=True)
    colors = np.stack([numbers >> 16, numbers >> 8 & 255, numbers & 255], axis=1).astype(np.uint8)
    order = np.argsort(-counts, kind="stable")
    chosen: list[Any] = []
    # Pillow takes two neighbours for one: of white and off-white it would show either.
    for color in colors[order[: 8 * _EXACT]].astype(int):
        if len(chosen) < _EXACT and all(np.abs(color - one).max() > _APART for one in chosen):
            chosen.append(color)
    weighted = np.repeat(colors, np.ceil(np.sqrt(counts)).astype(int), axis=0)
    blended = image.fromarray(weighted[None]).quantize(_BLENDED).getpalette()
    for color in np.array(blended[: 3 * _BLENDED]).reshape(-1, 3):
        if all(np.abs(color - one).max() > _APART for one in chosen):
            chosen.append(color)
    palette = image.new("P", (1, 1))
    palette.putpalette(np.concatenate(chosen).tolist())
    return palette


def _write_mp4(
    scene: LoopScene, moments: tuple[Moment, ...], path: Path, fps: float, encoder: str
) -> None:
    """Feed frames to ffmpeg; H.264 wants an even number of pixels each way."""
    height, width = (size - size % 2 for size in scene.pixels(moments[0]).shape[:2])
    source = ["-f", "rawvideo", "-pix_fmt", "rgb24", "-s", f"{width}x{height}", "-r", f"{fps:g}"]
    target = ["-an", "-c:v", "libx264", "-pix_fmt", "yuv420p", "-movflags", "+faststart"]
    command = [encoder, "-y", "-loglevel", "error", *source, "-i", "-", *target, str(path)]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stderr=subprocess.PIPE) as process:
        pipe, log = process.stdin, process.stderr
        assert pipe is not None
        assert log is not None
        # A broken pipe: ffmpeg has given up, and its message follows.
        with contextlib.suppress(BrokenPipeError):
            for pixels in _frames(scene, moments, {}):
                pipe.write(pixels[:height, :width].tobytes())
            pipe.close()
        said = log.read().decode(errors="replace").strip()
    if process.returncode != 0:
        raise MissingExtraError(
            f"{encoder} could not write {path.name!r}: {said or process.returncode}; MP4 needs an "
            "ffmpeg with libx264, such as that of the extra: pip install 'fgplan[mp4]'"
        )


def _ffmpeg() -> str:
    """The ffmpeg on the PATH, or the one inside the wheel of imageio-ffmpeg."""
    found = shutil.which("ffmpeg")
    if found is not None:
        return found
    try:
        wheel = importlib.import_module("imageio_ffmpeg")
    except ImportError as error:
        raise MissingExtraError(
            "films as .mp4 need ffmpeg, and there is none on the PATH; install it, or the extra: "
            "pip install 'fgplan[mp4]'; a .gif needs neither"
        ) from error
    return str(wheel.get_ffmpeg_exe())
