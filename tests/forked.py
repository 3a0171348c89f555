"""`chiplog` and `pytest` for the shell of a page, without paying for their imports each time.

Of a page's short command most is imports. A server does them once, and programs `chiplog` and
`pytest` that a page's shell finds first ask it for a fork. What runs there is what the installed
program runs: the same function, in a process of its own, with the caller's arguments, folder,
environment and streams, to the same exit status. That the installed programs themselves start is
held by tests/test_packaging.py. What is said of processes begun anew is not for a fork to prove: it
has the order of its sets from the server.
"""

from __future__ import annotations

import atexit
import gc
import json
import os
import select
import shutil
import signal
import socket
import subprocess
import sys
import tempfile
from collections.abc import Callable
from functools import cache
from importlib import import_module
from pathlib import Path
from typing import Final

_PRELOADED: Final = (
    "lean",
    "chiplog.entry",
    "chiplog.cli",
    "chiplog.pages.diagnosis",
    "chiplog.pages.report",
    "chiplog.run_folder",
    "chiplog.run_table",
    "gap_diagnosis.diagnose",
    "hil_harness.rig",
    "hil_harness.running",
    "pytest",
)
_PROGRAMS: Final = {"chiplog": ("chiplog.entry", "main"), "pytest": ("pytest", "console_main")}
_CLIENT: Final = """\
#!{python} -IS
import json, os, socket, sys
request = json.dumps([[{name!r}, *sys.argv[1:]], os.getcwd(), dict(os.environ)]).encode()
with socket.socket(socket.AF_UNIX) as server:
    server.connect({address!r})
    socket.send_fds(server, [len(request).to_bytes(8, "big")], [0, 1, 2])
    server.sendall(request)
    status = server.recv(1)
sys.exit(status[0] if status else "{name}: its process was lost")
"""


@cache
def folder_of_programs() -> Path:
    """Return where programs lie that are forked; their server ends with this process."""
    folder = Path(tempfile.mkdtemp(prefix="chiplog"))
    atexit.register(shutil.rmtree, folder)
    address = folder / "server"
    for name in _PROGRAMS:
        program = folder / name
        program.write_text(_CLIENT.format(python=sys.executable, name=name, address=str(address)))
        program.chmod(0o755)
    # Like the installed program's, its path of modules is without the folder that it starts in.
    code = "import sys, forked; sys.exit(forked.serve(sys.argv[1]))"
    server = subprocess.Popen(
        [sys.executable, "-P", "-c", code, str(address)],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        env={
            **os.environ,
            "PYTHONPATH": str(Path(__file__).parent),
            "PYTHONDONTWRITEBYTECODE": "1",
        },
    )
    atexit.register(server.communicate)  # its input ends, and so does it
    assert server.stdout is not None
    assert server.stdout.readline(), "the server of programs did not start"
    return folder


def serve(address: str) -> int:
    """Fork for whoever asks, until the process that started this one ends; return a fork's status.

    In the fork this returns as the program's own function does, and Python ends as it always does.
    """
    for name in _PRELOADED:
        import_module(name)
    known = import_module("chiplog")  # and loads its compiled kernels
    robot, drive = known.load_robot(), known.scenario("lesson")
    known.run(known.RunConfig(scenario=drive, robot=robot, duration_s=0.1))
    gc.freeze()  # what a fork's collections would only copy
    signal.signal(signal.SIGCHLD, signal.SIG_IGN)  # nobody waits for those who serve one command
    with socket.socket(socket.AF_UNIX) as listener:
        listener.bind(address)
        listener.listen()
        os.write(1, b"ready\n")
        while listener.fileno() in select.select([listener.fileno(), 0], [], [])[0]:
            asked, _ = listener.accept()
            with asked:
                if os.fork() == 0:
                    signal.signal(signal.SIGCHLD, signal.SIG_DFL)
                    listener.close()
                    return _one_command(asked)
    return 0


def _one_command(asked: socket.socket) -> int:
    """Run one command in a fork, and tell who asked its status; in the fork return it."""
    size, streams, _, _ = socket.recv_fds(asked, 8, 3)
    with asked.makefile("rb") as reader:
        words, folder, environment = json.loads(reader.read(int.from_bytes(size, "big")))
    command = os.fork()
    if command:
        for stream in streams:
            os.close(stream)
        status = os.waitstatus_to_exitcode(os.waitpid(command, 0)[1])
        asked.sendall(bytes([status if status >= 0 else 128 - status]))
        os._exit(0)
    asked.close()
    for descriptor, stream in enumerate(streams):
        os.dup2(stream, descriptor)
        os.close(stream)
    sys.stdin, sys.stdout, sys.stderr = os.fdopen(0), os.fdopen(1, "w"), os.fdopen(2, "w", 1)
    os.chdir(folder)
    os.environ.clear()
    os.environ.update(environment)
    sys.argv = words
    if words[0] == "pytest":  # what it imports as plugins it says of if it is there already
        for name in [one for one in sys.modules if one.partition(".")[0] in ("chiplog", "lean")]:
            del sys.modules[name]
    module, function = _PROGRAMS[words[0]]
    main: Callable[[], int] = getattr(import_module(module), function)
    return main()
