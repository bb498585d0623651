"""The UUID and the certificate by which SiLA clients know a server again, kept in a folder."""

from __future__ import annotations

import datetime
import ipaddress
import socket
import uuid
from pathlib import Path

from sila.framework.discovery import find_ip_addresses
from sila.framework.encryption import create_certificate

#: Clients trust a self-signed certificate by their copy of it, so they need a new copy when it ends.
LIFETIME = datetime.timedelta(days=3650)


class Identity:
    """A server's UUID, and a self-signed certificate that names it."""

    def __init__(self, folder: Path) -> None:
        folder.mkdir(mode=0o700, parents=True, exist_ok=True)
        self._uuid_file = folder / "uuid"
        self._key_file = folder / "private_key.pem"
        #: What clients need to trust the server.
        self.certificate_file = folder / "certificate.pem"
        if not self._uuid_file.exists():
            _write(self._uuid_file, str(uuid.uuid4()).encode())
        self.uuid = self._uuid_file.read_text().strip()

    def certificate(self, hostname: str) -> tuple[bytes, bytes]:
        """Certificate and private key, PEM. They are made for this host name or address at the first call."""
        if not (self.certificate_file.exists() and self._key_file.exists()):
            addresses = sorted({"127.0.0.1", *find_ip_addresses(hostname)})
            names = sorted({"localhost", socket.gethostname(), *([] if _is_address(hostname) else [hostname])})
            made = create_certificate(self.uuid, addresses, names, lifetime=LIFETIME)
            _write(self._key_file, made.pem_private_key)
            _write(self.certificate_file, made.pem_certificate)
        return self.certificate_file.read_bytes(), self._key_file.read_bytes()


def _is_address(hostname: str) -> bool:
    try:
        ipaddress.ip_address(hostname)
    except ValueError:
        return False
    return True


def _write(file: Path, content: bytes) -> None:
    part = file.with_suffix(".part")
    part.touch(mode=0o600)
    part.write_bytes(content)
    part.replace(file)
