"""Whom programs talk to: what strace sees of them and of their children, or, without it, what Python itself does."""

from __future__ import annotations

import ipaddress
import os
import re
import shutil
import subprocess
import sys
from dataclasses import dataclass
from functools import cache
from pathlib import Path

_CALLS = "connect,sendto,sendmsg,sendmmsg"
_ADDRESS = re.compile(r'sa_family=AF_INET6?\b.*?inet_(?:addr\("|pton\(AF_INET6, ")([^"]+)"')
_HOOK = """
import os, sys

def see(event, arguments):
    if event in ("socket.connect", "socket.sendto", "socket.sendmsg") and isinstance(arguments[1], tuple):
        with open(os.environ["SEEN_CONNECTIONS"], "a") as seen:
            print(arguments[1][0], file=seen)
    elif event == "socket.getaddrinfo":
        with open(os.environ["SEEN_CONNECTIONS"], "a") as seen:
            print(arguments[0], file=seen)

sys.addaudithook(see)
"""


@cache
def strace_works() -> bool:
    """Whether strace is installed and allowed to watch (in some containers it is not)."""
    found = shutil.which("strace")
    return found is not None and subprocess.run([found, "true"], capture_output=True, check=False).returncode == 0


@dataclass
class Watch:
    """Watches a program.

    Attributes:
        folder: for what it notes; empty at first.
        with_strace: sees native code, too; else only Python's own calls.
    """

    folder: Path
    with_strace: bool

    def start(self, *words: object, **more) -> subprocess.Popen:
        """Starts Python with these words, without what the tests themselves switch off."""
        environment = {name: value for name, value in os.environ.items() if name != "ORT_DISABLE_TELEMETRY"}
        command = [sys.executable, *map(str, words)]
        if self.with_strace:
            command = ["strace", "-f", "-qq", "-e", f"trace={_CALLS}", "-o", str(self._log), *command]
        else:
            (self.folder / "sitecustomize.py").write_text(_HOOK)
            paths = [str(self.folder), *filter(None, [environment.get("PYTHONPATH")])]
            environment |= {"PYTHONPATH": os.pathsep.join(paths), "SEEN_CONNECTIONS": str(self._log)}
        return subprocess.Popen(command, env=environment, text=True, **more)

    def seen_elsewhere(self) -> list[str]:
        """Addresses and names, other than this computer's, that were talked to or asked for."""
        lines = self._log.read_text(errors="replace").splitlines() if self._log.exists() else []
        found = [match for line in lines for match in _ADDRESS.findall(line)] if self.with_strace else lines
        return [address for address in found if not _is_here(address)]

    @property
    def _log(self) -> Path:
        return self.folder / "connections.txt"


def _is_here(address: str) -> bool:
    try:
        return ipaddress.ip_address(address).is_loopback
    except ValueError:
        return address in ("localhost", "None", "")
