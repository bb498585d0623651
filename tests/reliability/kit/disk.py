"""What is in a data folder, read without carved."""

from __future__ import annotations

import hashlib
import json
import os
import struct
import zlib
from pathlib import Path
from typing import Any

from .sse import Event


def sha256(path: Path) -> str:
    """The SHA-256 of a file, in hexadecimal digits."""
    return hashlib.sha256(path.read_bytes()).hexdigest()


def files_that_differ(folder: Path) -> list[str]:
    """The files that are missing or differ from the folder's SHA256SUMS."""
    differ = []
    for line in (folder / "SHA256SUMS").read_text().splitlines():
        wanted, name = line.split("  ", 1)
        path = folder / name
        if not path.is_file() or sha256(path) != wanted:
            differ.append(name)
    return differ


def journal(path: Path) -> list[Event]:
    """The complete lines of a journal."""
    raw = path.read_bytes() if path.exists() else b""
    return [json.loads(line) for line in raw[: raw.rfind(b"\n") + 1].splitlines()]


def read_json(path: Path) -> Any:
    """A JSON file."""
    return json.loads(path.read_text())


def tree(folder: Path) -> dict[str, str]:
    """The SHA-256 of every file below a folder, by its path. Pipes and broken links have a question mark."""
    found = {}
    for parent, _, names in os.walk(folder):
        for name in names:
            path = Path(parent, name)
            found[os.path.relpath(path, folder)] = sha256(path) if path.is_file() else "?"
    return found


def pixels_sha256(png: Path) -> str:
    """The SHA-256 of the pixels of a PNG of 8 bits per sample without interlacing."""
    raw, at, packed, width, height, samples = png.read_bytes(), 8, b"", 0, 0, 1
    while at < len(raw):
        length, kind = struct.unpack(">I4s", raw[at : at + 8])
        data = raw[at + 8 : at + 8 + length]
        if kind == b"IHDR":
            width, height, depth, colour, _, _, interlaced = struct.unpack(">IIBBBBB", data)
            if depth != 8 or interlaced:
                raise ValueError(f"{png}: {depth} bits, interlaced: {interlaced}")
            samples = {0: 1, 2: 3, 4: 2, 6: 4}[colour]
        elif kind == b"IDAT":
            packed += data
        at += 12 + length
    unpacked, bytes_per_row = zlib.decompress(packed), width * samples
    digest, above = hashlib.sha256(), bytes(bytes_per_row)
    for row in range(height):
        start = row * (bytes_per_row + 1)
        above = _unfilter(unpacked[start], unpacked[start + 1 : start + 1 + bytes_per_row], above, samples)
        digest.update(above)
    return digest.hexdigest()


def _unfilter(kind: int, line: bytes, above: bytes, samples: int) -> bytes:
    if kind == 0:
        return line
    if kind == 2:
        # All bytes at once: the even and the odd ones apart, so that no sum reaches the next byte.
        even = int.from_bytes(b"\x00\xff" * ((len(line) + 1) // 2), "big")
        odd = even << 8
        a, b = int.from_bytes(b"\0" * (len(line) % 2) + line, "big"), int.from_bytes(above, "big")
        total = (((a & even) + (b & even)) & even) | (((a & odd) + (b & odd)) & odd)
        return total.to_bytes(len(line) + len(line) % 2, "big")[len(line) % 2 :]
    out = bytearray(line)
    for i in range(len(out)):
        left = out[i - samples] if i >= samples else 0
        up = above[i]
        corner = above[i - samples] if i >= samples else 0
        if kind == 1:
            predicted = left
        elif kind == 3:
            predicted = (left + up) // 2
        else:
            p = left + up - corner
            predicted = min((left, up, corner), key=lambda v: abs(p - v))
        out[i] = (out[i] + predicted) & 0xFF
    return bytes(out)
