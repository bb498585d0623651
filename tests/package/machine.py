"""A Debian with systemd as its first process, booted in namespaces by systemd-nspawn: no virtual machine, nothing stays."""

import pathlib
import signal
import subprocess
import sys
import time


class Failed(Exception):
    """A check has failed, or the machine has not done in time what it was asked for."""


def base(folder: pathlib.Path, packages: list[str]) -> None:
    """Makes the system once: what Debian 12 installs, and the libraries that the package depends on."""
    if (folder / "complete").exists():
        return
    subprocess.run(["rm", "-rf", folder], check=True)
    command = ["debootstrap", "--variant=minbase", f"--include={','.join(packages)}", "bookworm", str(folder)]
    done = subprocess.run(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)
    if done.returncode != 0:
        raise Failed(f"debootstrap: {done.stdout[-2000:]}")
    (folder / "complete").touch()


class Machine:
    """A booted system over a base that stays as it is: what is written goes into memory."""

    def __init__(self, root: pathlib.Path, binds: dict[pathlib.Path, str], log: pathlib.Path):
        options = [f"--bind-ro={source}:{target}" for source, target in binds.items()]
        command = ["systemd-nspawn", "--boot", "--register=no", "--keep-unit", "--private-network", "--volatile=overlay"]
        self.log = log
        self.nspawn = subprocess.Popen(
            [*command, f"--directory={root}", "--machine=carved-package", "--console=pipe", *options],
            stdin=subprocess.DEVNULL,
            stdout=log.open("wb"),
            stderr=subprocess.STDOUT,
        )
        try:
            self.leader = self.until("systemd to start", self._leader)
            self.until("the boot", lambda: self.run("systemctl is-system-running", check=False).strip() in ("running", "degraded"))
        except BaseException:
            self.off()
            raise

    def _leader(self) -> str | None:
        if self.nspawn.poll() is not None:
            raise Failed(f"systemd-nspawn has ended: {self.log.read_text(errors='replace')[-2000:]}")
        listed = pathlib.Path(f"/proc/{self.nspawn.pid}/task/{self.nspawn.pid}/children").read_text().split()
        names = {child: pathlib.Path(f"/proc/{child}/comm").read_text().strip() for child in listed}
        return next((child for child, name in names.items() if name == "systemd"), None)

    def run(self, command: str, check: bool = True) -> str:
        """Runs a shell command inside as root, and returns what it says."""
        inside = ["nsenter", "--target", self.leader, "--all", "--root", "--wd", "env", "-i", "PATH=/usr/sbin:/usr/bin:/sbin:/bin"]
        done = subprocess.run([*inside, "sh", "-c", command], stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, timeout=600)
        if check and done.returncode != 0:
            raise Failed(f"{command}: exit code {done.returncode}\n{done.stdout[-3000:]}")
        return done.stdout

    def until(self, what: str, ready, within: float = 300):
        """Waits until `ready` returns something that is true, and returns it."""
        ends = time.monotonic() + within
        while time.monotonic() < ends:
            if found := ready():
                return found
            time.sleep(0.2)
        raise Failed(f"waited {within:.0f} s for {what}")

    def off(self) -> None:
        """Switches the machine off."""
        self.nspawn.send_signal(signal.SIGTERM)
        try:
            self.nspawn.wait(30)
        except subprocess.TimeoutExpired:
            self.nspawn.kill()
            self.nspawn.wait()


def step(text: str) -> None:
    """Says which step begins."""
    print(f"deb-test: {text}", flush=True)


def expect(condition: object, text: str) -> None:
    """Ends the test if the condition does not hold."""
    if not condition:
        raise Failed(text)


def main(test) -> None:
    """Runs a test, and ends with exit code 1 and its reason if it fails."""
    try:
        test()
    except (Failed, subprocess.TimeoutExpired) as failed:
        sys.exit(f"deb-test: FAILED: {failed}")
