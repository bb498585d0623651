#!/usr/bin/env python3
"""Makes the named pipe of VastNavigateServer a TCP port, so that carved can turn a VAST from another computer.

    carved -- TCP --> this program -- named pipe --> VastNavigateServer -- VAST's own library

Start it on VAST's computer, beside VastNavigateServer. It needs Python 3.8 or newer and nothing else:

    python vast_pipe_relay.py --listen 192.168.10.3:5000

Messages are the same on both sides: a length of four bytes, little endian, and that many ASCII characters. Every request gets one
answer. If the pipe cannot be used, the answer begins with "error:" and says what to do.

VastNavigateServer serves one client per press of its Connect button. So this program keeps the pipe open while carved's connections
come and go. Only the newest connection is served. The protocol has no password: let --listen be an address that only carved's computer can reach.
"""

import argparse
import os
import socket
import stat
import struct
import sys
import threading

LONGEST_REQUEST = 256
LONGEST_ANSWER = 512
PRESS_CONNECT = "press Connect in VastNavigateServer"


def say(text):
    print(text, flush=True)


def exactly(read, count):
    """The next count bytes. EOFError if the other side has closed."""
    got = b""
    while len(got) < count:
        more = read(count - len(got))
        if not more:
            raise EOFError("the other side has closed")
        got += more
    return got


def frame(text):
    return struct.pack("<I", len(text)) + text


def read_frame(read, longest):
    (length,) = struct.unpack("<I", exactly(read, 4))
    if length > longest:
        raise ValueError(f"a message of {length} bytes; the longest has {longest}")
    return exactly(read, length)


class Pipe:
    """The pipe of VastNavigateServer. It is opened at the first request and again after a failure."""

    def __init__(self, path):
        self.path = path
        self.file = None
        self.lock = threading.Lock()
        self.newest = None

    def ask(self, request, client):
        """The answer to a request, or a text that begins with "error:". EOFError if a newer client has come.

        While the pipe hangs, carved connects again after each timeout. What its earlier connections asked must not be done later.
        """
        while not self.lock.acquire(timeout=0.2):
            if client is not self.newest:
                raise EOFError("a newer client has come")
        try:
            if client is not self.newest:
                raise EOFError("a newer client has come")
            return self.exchange(request)
        finally:
            self.lock.release()

    def exchange(self, request):
        """One request and its answer, with the lock held."""
        if self.file is None:
            try:
                self.file = open_pipe(self.path)
            except OSError as error:
                return f"error: no pipe {self.path} ({error.strerror}): {PRESS_CONNECT}".encode("ascii", "replace")
            say(f"connected to {self.path}")
        try:
            write_all(self.file, frame(request))
            turn_round(self.file)
            answer = read_frame(self.file.read, LONGEST_ANSWER)
            turn_round(self.file)
            return answer
        except (OSError, EOFError, ValueError) as error:
            say(f"the pipe has failed: {error}")
            self.file.close()
            self.file = None
            return f"error: the pipe has failed: {PRESS_CONNECT}".encode("ascii")


def open_pipe(path):
    """Opens a Windows named pipe, or a Unix socket at this path."""
    if os.name != "nt" and stat.S_ISSOCK(os.stat(path).st_mode):
        connection = socket.socket(socket.AF_UNIX)
        connection.connect(path)
        return connection.makefile("rwb", buffering=0)
    return open(path, "r+b", buffering=0)


def turn_round(file):
    """Between writing and reading, as the public client of VastNavigateServer does on Windows."""
    if os.name == "nt":
        file.seek(0)


def write_all(file, data):
    while data:
        data = data[file.write(data) :]


def serve(client, pipe):
    """Answers one client until it has gone."""
    with client:
        try:
            while True:
                answer = pipe.ask(read_frame(client.recv, LONGEST_REQUEST), client)
                client.sendall(frame(answer))
        except (OSError, EOFError, ValueError) as error:
            say(f"a client has gone: {error}")


def main():
    parser = argparse.ArgumentParser(description="Makes the named pipe of VastNavigateServer a TCP port.")
    parser.add_argument("--listen", default="127.0.0.1:5000", help="address and port that carved connects to (default: %(default)s)")
    parser.add_argument("--pipe", default=r"\\.\pipe\VastServerPipe", help="the pipe (default: %(default)s)")
    arguments = parser.parse_args()
    host, _, port = arguments.listen.rpartition(":")
    if not host or not port.isdigit():
        parser.error(f"--listen {arguments.listen}: expected ADDRESS:PORT, such as 192.168.10.3:5000")
    try:
        listener = socket.create_server((host, int(port)))
    except OSError as error:
        sys.exit(f"cannot listen on {arguments.listen}: {error.strerror}. Use an address of this computer and a free port.")
    address, bound = listener.getsockname()[:2]
    say(f"listening on {address}:{bound} for {arguments.pipe}")
    pipe = Pipe(arguments.pipe)
    while True:
        client, peer = listener.accept()
        say(f"a client has come: {peer[0]}")
        client.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        pipe.newest = client
        threading.Thread(target=serve, args=(client, pipe), daemon=True).start()


if __name__ == "__main__":
    try:
        main()
    except KeyboardInterrupt:
        pass
