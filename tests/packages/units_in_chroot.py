#!/usr/bin/env python3
"""Starts each service inside a chroot as its unit would and hears that it is ready and alive.

  units_in_chroot.py ROOT MAP      MAP as seen inside; exit code 1 and what was said if one is not
"""

import pathlib
import re
import socket
import subprocess
import sys
import uuid


def setup_of(unit):
    """Environment and command of a unit, its instance called alpha."""
    environment = {}
    for line in re.findall(r"(?m)^Environment=(.*)$", unit):
        key, _, value = line.partition("=")
        environment[key] = value.replace("%i", "alpha")
    command = re.search(r"(?m)^ExecStart=(.*)$", unit).group(1).replace("$$", "$").replace("%%", "%")
    return environment, re.sub(r"\$\{(\w+)\}", r'"${\1}"', command)


def talk(command, environment, listener):
    """Starts a service, waits until it was heard alive twice, stops it. What it told, its exit code and words."""
    child = subprocess.Popen(command, env=environment, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)
    heard = []
    listener.settimeout(20)
    try:
        while sum("WATCHDOG=1" in words for words in heard) < 2:
            heard.append(listener.recv(4096).decode())
        child.terminate()
        while "STOPPING=1" not in heard:
            heard.append(listener.recv(4096).decode())
        listener.settimeout(1)
        listener.recv(4096)  # its last status comes after that
    except socket.timeout:
        pass
    finally:
        child.terminate()
        said, _ = child.communicate(timeout=20)
    return heard, child.returncode, said


def main():
    root, map_folder = pathlib.Path(sys.argv[1]), sys.argv[2]
    name = f"notify_{uuid.uuid4().hex}"
    (root / "tmp/logs").mkdir()
    failures = 0
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as listener:
        listener.bind(str(root / "tmp" / name))
        for path in sorted((root / "usr/lib/systemd/system").glob("hedgehop-*@.service")):
            environment, command = setup_of(path.read_text())
            environment.update(HEDGEHOP_MAP=map_folder, PATH="/usr/sbin:/usr/bin:/sbin:/bin", NOTIFY_SOCKET=f"/tmp/{name}",
                               STATE_DIRECTORY="/tmp/logs")
            network = "ip link set lo up && ip route add 224.0.0.0/4 dev lo && exec "
            heard, code, said = talk(["chroot", root, "unshare", "-n", "sh", "-c", network + command], environment, listener)
            good = code == 0 and heard[:1] == ["READY=1"] and "STOPPING=1" in heard
            print(f"{path.name}: {'ready, alive, left' if good else f'exit code {code}, told {heard}, said {said}'}")
            failures += not good
    return 1 if failures else 0


if __name__ == "__main__":
    sys.exit(main())
