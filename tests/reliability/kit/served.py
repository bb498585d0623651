"""`carved serve` on a configuration without hardware: it reads a folder of pictures."""

from __future__ import annotations

import re
from pathlib import Path

from .daemon import Daemon
from .row import Context


def configuration(context: Context, port: int, listen: str | None = None, **http: str | int) -> Path:
    """Writes a configuration from `config/vast-folder.toml`. `http` has further keys of `[http]`, as TOML values."""
    text = (context.source / "config/vast-folder.toml").read_text()
    lines = [f'listen = "{listen or f"127.0.0.1:{port}"}"', *(f"{key} = {value}" for key, value in http.items())]
    pictures = context.work / "pictures"
    pictures.mkdir(parents=True, exist_ok=True)
    for pattern, replaced in (
        (r"(?m)^listen = .*$", "\n".join(lines)),
        (r"(?m)^data_dir = .*$", f'data_dir = "{context.work / "data"}"'),
        (r"(?m)^folder = .*$", f'folder = "{pictures}/{{plate}}"'),
    ):
        text, found = re.subn(pattern, replaced, text, count=1)
        if not found:
            raise ValueError(f"config/vast-folder.toml has no line {pattern}")
    path = context.work / "carved.toml"
    path.write_text(text)
    return path


def serve(context: Context, port: int, token: str | None = None, **http: str | int) -> Daemon:
    """Serves that configuration."""
    path = configuration(context, port, None, **http)
    return Daemon(
        context.binary,
        context.work / "data",
        port,
        log=context.work / "daemon.log",
        command=[context.binary, "serve", "--config", path],
        token=token,
    )
