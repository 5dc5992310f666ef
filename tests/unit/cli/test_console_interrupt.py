"""An interrupt that compiled code has swallowed is raised again."""

import contextlib
import os
import signal
import sys

import pytest

from rotorid.cli.console import check, listen, progress


@pytest.fixture(autouse=True)
def handlers() -> object:
    kept = {number: signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)}
    hook = sys.unraisablehook
    yield
    listen()
    sys.unraisablehook = hook
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


class Dying:
    """Raises where nobody can catch it, as in a callback."""

    def __init__(self, error: type[BaseException]) -> None:
        self.error = error

    def __del__(self) -> None:
        raise self.error


def test_an_interrupt_lost_in_a_callback_is_not_printed(capfd: pytest.CaptureFixture[str]) -> None:
    listen()
    for error in (KeyboardInterrupt, ZeroDivisionError):
        Dying(error)
    said = capfd.readouterr().err
    assert "KeyboardInterrupt" not in said
    assert "ZeroDivisionError" in said
