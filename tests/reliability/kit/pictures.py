"""Pictures that a decoder must refuse, made byte by byte."""

from __future__ import annotations

import os
import struct
import zlib
from pathlib import Path


def png(width: int, height: int, rows: bytes = b"", depth: int = 8, colour: int = 0, packed: bytes | None = None) -> bytes:
    """A PNG with these scan lines, filter bytes included."""

    def chunk(kind: bytes, data: bytes) -> bytes:
        return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))

    head = struct.pack(">IIBBBBB", width, height, depth, colour, 0, 0, 0)
    body = zlib.compress(rows) if packed is None else packed
    return b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", head) + chunk(b"IDAT", body) + chunk(b"IEND", b"")


def bomb(side: int) -> bytes:
    """A complete PNG of `side` x `side` zeros, packed into little."""
    packer, row = zlib.compressobj(9), b"\0" * (side + 1)
    return png(side, side, packed=b"".join(packer.compress(row) for _ in range(side)) + packer.flush())


def _tiff(side: int) -> bytes:
    tags = ((256, side), (257, side), (258, 8), (259, 1), (262, 1), (273, 8), (277, 1), (278, side), (279, 3_600_000_000))
    entries = b"".join(struct.pack("<HHII", tag, 4, 1, value) for tag, value in tags)
    return b"II*\0" + struct.pack("<I", 8) + struct.pack("<H", len(tags)) + entries + struct.pack("<I", 0)


def _bmp(side: int) -> bytes:
    info = struct.pack("<IiiHHIIiiII", 40, side, side, 1, 24, 0, 0, 0, 0, 0, 0)
    return b"BM" + struct.pack("<IHHI", 54, 0, 0, 54) + info


def bad_pictures(frame: bytes) -> dict[str, bytes]:
    """Bad pictures by their names; `frame` is a good PNG."""
    flat = (b"\0" + b"\x80" * 1024) * 1024
    return {
        "zero.png": b"",
        "cut.png": frame[: len(frame) // 2],
        "head.png": frame[:20],
        "text.png": b"hello\n" * 50,
        "huge_header.png": png(60_000, 60_000),
        "huge_true.png": bomb(30_000),
        "wide.png": png(2**31 - 1, 1),
        "no_size.png": png(0, 0),
        "tiny.png": png(1, 1, b"\0\0"),
        "crc.png": frame[:60] + bytes([frame[60] ^ 1]) + frame[61:],
        "constant.png": png(1024, 1024, flat),
        "depth.png": png(1024, 1024, flat, depth=3),
        "colour.png": png(1024, 1024, flat, colour=5),
        "huge.bmp": _bmp(60_000),
        "negative.bmp": _bmp(-60_000),
        "huge.tif": _tiff(60_000),
        "no_end.tif": b"II*\0\xff\xff\xff\x7f",
        "loop.tif": b"II*\0" + struct.pack("<IH", 8, 0) + struct.pack("<I", 8),
        "cut.jpg": b"\xff\xd8\xff\xe0\x00\x10JFIF\0",
        "huge.jpg": b"\xff\xd8\xff\xc0\x00\x0b\x08\xff\xff\xff\xff\x01\x01\x11\x00\xff\xd9",
    }


def write_bad_pictures(folder: Path, frame: bytes) -> list[str]:
    """Writes them, and a link to itself, a pipe and a folder that are called pictures. Returns the names."""
    folder.mkdir(parents=True)
    for name, content in bad_pictures(frame).items():
        (folder / name).write_bytes(content)
    (folder / "link.png").symlink_to("link.png")
    os.mkfifo(folder / "pipe.png")
    (folder / "folder.png").mkdir()
    return sorted(path.name for path in folder.iterdir())
