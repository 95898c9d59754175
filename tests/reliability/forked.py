"""A bad input, and a call in a process of its own: what it said, or how it died."""

from __future__ import annotations

import os
import resource
import select
import signal
import time
from collections.abc import Callable
from typing import NamedTuple

from wbc.errors import WbcError

PATIENCE = 120.0  # seconds: on a busy machine a sound call waits for a processor
MEMORY = 6 << 30  # bytes of address space


class Case(NamedTuple):
    """``call(solver)``; ``says`` are words of the refusal, None for an answer that has been checked."""

    name: str
    call: Callable[[str], object]
    says: tuple[str, ...] | None = None


class Outcome(NamedTuple):
    """``kind`` is answered, refused (a typed error), raised (any other), died or hung; ``text`` what was said."""

    kind: str
    text: str


def forked(call: Callable[[], object]) -> Outcome:
    """What becomes of ``call()`` in a fork with bounded time and memory. Files it may have open stay open here."""
    reading, writing = os.pipe()
    child = os.fork()
    if child == 0:
        os.close(reading)
        os.write(writing, _tried(call).encode(errors="replace")[:4000])
        os._exit(0)
    os.close(writing)
    said, end = b"", time.monotonic() + PATIENCE
    with os.fdopen(reading, "rb", buffering=0) as pipe:
        while True:
            ready, _, _ = select.select([pipe], [], [], max(0.0, end - time.monotonic()))
            part = pipe.read(4096) if ready else b""
            said += part
            if not part:
                break
    if not said and time.monotonic() >= end:
        os.kill(child, signal.SIGKILL)
        os.waitpid(child, 0)
        return Outcome("hung", f"no answer in {PATIENCE:g} s")
    _, status = os.waitpid(child, 0)
    if not said:
        return Outcome("died", f"signal {os.WTERMSIG(status)}" if os.WIFSIGNALED(status) else f"exit {status >> 8}")
    kind, _, text = said.decode().partition(" ")
    return Outcome(kind, text)


def _tried(call: Callable[[], object]) -> str:
    resource.setrlimit(resource.RLIMIT_AS, (MEMORY, MEMORY))
    try:
        return f"answered {call()}"
    except WbcError as error:
        return f"refused {type(error).__name__}: {error}"
    except BaseException as error:
        return f"raised {type(error).__name__}: {error}"
