"""Portable graymap images (Netpbm PGM): plain P2 and raw P5, 8 or 16 bits.

Header: the magic, then width, height and the greatest value as decimal text, separated by
blanks, with comments from `#` to the end of a line; in P5 a single blank, then the rows from the
top, one byte a pixel (two, big-endian, if the greatest value exceeds 255).
"""

import re
from pathlib import Path

import numpy as np

from roadmaps.errors import MapFileError
from roadmaps.typing import FloatArray

_TOKEN = re.compile(rb"(?:\s|#[^\n\r]*[\n\r])*([^\s#]+)")


def read_pgm(path: Path) -> FloatArray:
    """Read a PGM image.

    Args:
        path: The file.

    Returns:
        Grey values from 0 (black) to 1 (white), shape (height, width), row 0 at the top.

    Raises:
        MapFileError: If it is not a PGM, or pixels are missing, left over or too large.
    """
    try:
        data = path.read_bytes()
    except OSError as error:
        raise MapFileError(f"{path}: expected a readable PGM image: {error}") from error
    if data[:2] not in (b"P2", b"P5"):
        raise MapFileError(
            f"{path}: expected a PGM image (starting with P2 or P5), got {data[:8]!r}; convert "
            "other formats first, e.g. `convert map.png map.pgm`"
        )
    place = 2
    header: list[int] = []
    for field in ("width", "height", "greatest value"):
        match = _TOKEN.match(data, place)
        token = match.group(1) if match else b""
        if match is None or not token.isdigit() or not 0 < int(token) <= 10**6:
            raise MapFileError(f"{path}: {field}: expected a positive integer, got {token[:20]!r}")
        header.append(int(token))
        place = match.end()
    width, height, greatest = header
    if greatest > 65535:
        raise MapFileError(f"{path}: greatest value: expected at most 65535, got {greatest}")
    if data[:2] == b"P5":
        kind = np.dtype(np.uint8 if greatest < 256 else ">u2")
        body = data[place + 1 :]
        found = len(body) // kind.itemsize
        pixels = np.frombuffer(body, dtype=kind, count=min(found, width * height))
        if body[width * height * kind.itemsize :].strip():
            raise MapFileError(
                f"{path}: pixels: expected {width} x {height} = {width * height}, got {found}; "
                "the header is wrong, or the file holds more than one image"
            )
    else:
        text = re.sub(rb"#[^\n\r]*", b"", data[place:]).split()
        wrong = next((word for word in text if not word.isdigit()), None)
        if wrong is not None:
            raise MapFileError(f"{path}: pixels: expected integers, got {wrong[:20]!r}")
        found = len(text)
        pixels = np.array(text[: width * height], dtype=np.int64)
        if found > width * height:
            raise MapFileError(
                f"{path}: pixels: expected {width} x {height} = {width * height}, got {found}"
            )
    if found < width * height:
        raise MapFileError(
            f"{path}: pixels: expected {width} x {height} = {width * height}, got {found}; the "
            "file is cut off or its header is wrong"
        )
    if pixels.max() > greatest:
        raise MapFileError(
            f"{path}: pixels: expected at most the header's {greatest}, got {pixels.max()}"
        )
    return pixels.reshape(height, width).astype(np.float64) / float(greatest)
