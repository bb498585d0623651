"""The SiLA server of one instrument."""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import AsyncIterator
from pathlib import Path

from sila.server import Discovery, Server, ServerConfig

from .. import instrument
from .features import FEATURES
from .feed import StatusFeed

#: How long commands may go on while the server ends, in milliseconds. A run goes on at the instrument in any case.
GRACE_MS = 1000.0


@contextlib.asynccontextmanager
async def connector(
    carved_url: str, config: ServerConfig, *, token_file: Path | None = None, discovery: bool = True
) -> AsyncIterator[Server]:
    """Serves the features of one instrument inside the block. The instrument need not be there yet."""
    client = instrument.connect(carved_url, token_file)
    feed = StatusFeed(instrument.connect(carved_url, token_file, quick=True))
    server = Server(config)
    # The server only refers to its features.
    features = [implementation(client, feed) for implementation in FEATURES]
    for each in features:
        server.register_feature(each.feature)
    feed.start()
    await server.start()
    announced = Discovery(server) if discovery else None
    announcing = None if announced is None else asyncio.create_task(announced.start())
    try:
        yield server
    finally:
        feed.stop()
        if announced is not None and announcing is not None:
            announcing.cancel()
            await announced.stop()
        await server.stop(GRACE_MS)
        client.close()
