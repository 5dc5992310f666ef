"""An interrupt that compiled code has swallowed is raised again."""

import contextlib
import os
import signal

import pytest

from rotorid.cli.console import check, listen, progress


@pytest.fixture(autouse=True)
def handlers() -> object:
    kept = {number: signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)}
    yield
    listen()
    for number, handler in kept.items():
        signal.signal(number, handler)


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_swallowed_interrupt_comes_back_with_the_next_word(number: signal.Signals) -> None:
    listen()
    check()
    with contextlib.suppress(KeyboardInterrupt):
        os.kill(os.getpid(), number)
    with progress(quiet=True) as tell, pytest.raises(KeyboardInterrupt):
        tell("going on")


def test_a_new_command_forgets_the_last_interrupt() -> None:
    listen()
    with contextlib.suppress(KeyboardInterrupt):
        os.kill(os.getpid(), signal.SIGINT)
    listen()
    check()
