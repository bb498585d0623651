"""The command of the SiLA server: `python -m carved_client.integrations.sila --help`."""

from __future__ import annotations

import argparse
import asyncio
import ipaddress
import os
import signal
from pathlib import Path

from sila.server import ServerConfig

from .connector import connector
from .identity import Identity


def main() -> None:
    """Serves until SIGTERM or Ctrl-C."""
    parser = _parser()
    asked = parser.parse_args()
    host, _, port = asked.listen.rpartition(":")
    if not host or not port.isdecimal():
        parser.error(f"--listen {asked.listen} is not an address: write it like 127.0.0.1:50052")
    if not (_is_loopback(host) or asked.client_authority or asked.allow_any_client):
        parser.error(
            f"every client that reaches {host} could move the instrument: name the authority of the clients that may "
            "by --client-authority, or accept every client by --allow-any-client"
        )
    if asked.insecure and asked.client_authority:
        parser.error("--client-authority needs encryption: leave out --insecure")
    identity = Identity(asked.folder)
    certificate, key = (None, None) if asked.insecure else identity.certificate(host)
    config = ServerConfig(
        hostname=host,
        port=int(port),
        tls=not asked.insecure,
        certificate_chain=certificate,
        private_key=key,
        require_client_auth=asked.client_authority is not None,
        root_certificates=None if asked.client_authority is None else asked.client_authority.read_bytes(),
        uuid=identity.uuid,
        name=asked.name,
        type="Carved",
        description="Measures zebrafish larvae in 3D while they turn in a glass capillary.",
        version="1.0",
        vendor_url=asked.carved,
    )
    trust = "without encryption" if asked.insecure else f"clients trust {identity.certificate_file}"
    asyncio.run(_serve(asked, config, trust))


async def _serve(asked: argparse.Namespace, config: ServerConfig, trust: str) -> None:
    done = asyncio.Event()
    for wanted in (signal.SIGTERM, signal.SIGINT):
        asyncio.get_running_loop().add_signal_handler(wanted, done.set)
    async with connector(asked.carved, config, token_file=asked.token_file, discovery=asked.discovery) as server:
        print(f"SiLA server {server.uuid} of {asked.carved} on {server._address}, {trust}", flush=True)
        await done.wait()


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="python -m carved_client.integrations.sila", description="carved as a SiLA 2 server."
    )
    state = Path(os.environ.get("XDG_STATE_HOME") or Path.home() / ".local" / "state")
    add = parser.add_argument
    add("--carved", default="http://127.0.0.1:8420", metavar="URL", help="the carved daemon (%(default)s)")
    add("--token-file", type=Path, metavar="FILE", help="the file with the token of the daemon")
    add("--listen", default="127.0.0.1:50052", metavar="HOST:PORT", help="where clients connect (%(default)s)")
    add("--name", default="carved", help="the name that clients show (%(default)s)")
    add(
        "--folder",
        type=Path,
        default=state / "carved-sila",
        help="keeps the server's UUID and its self-signed certificate (%(default)s)",
    )
    add("--client-authority", type=Path, metavar="PEM", help="accept only clients with a certificate of this authority")
    add("--allow-any-client", action="store_true", help="off loopback: accept every client that reaches the port")
    add("--insecure", action="store_true", help="no encryption, against the SiLA standard")
    add("--no-discovery", dest="discovery", action="store_false", help="do not announce the server by mDNS")
    return parser


def _is_loopback(host: str) -> bool:
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return host == "localhost"


if __name__ == "__main__":
    main()
