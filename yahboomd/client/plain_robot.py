"""The client for programs without asyncio: the same core, on a thread of its own."""

from __future__ import annotations

import asyncio
import atexit
import concurrent.futures
import logging
import math
import os
import threading
from collections.abc import Callable, Coroutine, Iterator, Sequence
from contextlib import suppress
from functools import wraps
from pathlib import Path
from typing import TYPE_CHECKING, Any, Concatenate, ParamSpec, TypeVar

import msgspec

from yahboomd.client.async_robot import DEADMAN_S, RATE_HZ, WAIT_S, AsyncRobot, connect
from yahboomd.client.commanding import Counters
from yahboomd.client.connection import ENDPOINT
from yahboomd.client.endings import Endings, shorten
from yahboomd.client.move_messages import Move, MoveSample
from yahboomd.client.robot_moves import MoveRun
from yahboomd.client.streams import NewestSamples, Samples
from yahboomd.core.clock import timeout
from yahboomd.core.errors import BusError, NoDaemon
from yahboomd.core.model import Twist2d

if TYPE_CHECKING:
    from typing_extensions import Self

log = logging.getLogger("yahboomd.client")

Message = TypeVar("Message", bound=msgspec.Struct)
Result = TypeVar("Result")
Arguments = ParamSpec("Arguments")


def _waiting(
    method: Callable[Concatenate[AsyncRobot, Arguments], Coroutine[Any, Any, Result]],
) -> Callable[Concatenate[Robot, Arguments], Result]:
    """The method of :class:`Robot` that waits for this one: same arguments and docstring."""

    @wraps(method)
    def waiting(self: Robot, /, *args: Arguments.args, **kwargs: Arguments.kwargs) -> Result:
        return self._wait(method(self._robot, *args, **kwargs))

    return waiting


def _at_once(
    method: Callable[Concatenate[AsyncRobot, Arguments], Result],
) -> Callable[Concatenate[Robot, Arguments], Result]:
    """The method of :class:`Robot` that calls this one: same arguments and docstring."""

    @wraps(method)
    def calling(self: Robot, /, *args: Arguments.args, **kwargs: Arguments.kwargs) -> Result:
        return self._now(lambda: method(self._robot, *args, **kwargs))

    return calling


class Robot(NewestSamples):
    """One robot, through its daemon: ``with Robot("tcp/192.168.1.5:7448") as robot:``.

    Entering waits for the daemon; leaving stops the robot, also after an exception, Ctrl-C,
    SIGTERM and SIGHUP. A thread repeats commands, so a program may sleep between them; one that
    hangs stops driving after the deadman's time. The methods may be called from any thread.

    Args:
        endpoint: The address of the daemon or its router, or several of them.
        namespace: The robot's, as in the section ``[zenoh]`` of its configuration.
        source: The key to command on; the daemon's ``[command.sources]`` gives it its priority.
            Default: ``cmd_vel``; with a person's file of a fleet, ``cmd_vel/NAME``.
        label: Who commands, for people who read the daemon's status.
        deadman_s: How long a command without ``for_s`` lasts, in seconds.
        rate_hz: How often a command is repeated. The daemon stops the robot after 0.5 s of silence.
        wait_s: How long entering waits for the daemon, in seconds; ``math.inf``: without limit.
        zenoh_file: A JSON5 file of Zenoh's, for certificates and passwords.

    Raises:
        ValueError: An argument is out of range.
    """

    def __init__(
        self,
        endpoint: str | Sequence[str] = ENDPOINT,
        *,
        namespace: str = "",
        source: str | None = None,
        label: str = "",
        deadman_s: float = DEADMAN_S,
        rate_hz: float = RATE_HZ,
        wait_s: float = WAIT_S,
        zenoh_file: str | Path | None = None,
    ) -> None:
        self._robot = connect(
            endpoint,
            namespace=namespace,
            source=source,
            label=label,
            deadman_s=deadman_s,
            rate_hz=rate_hz,
            wait_s=wait_s,
            zenoh_file=zenoh_file,
        )
        self._loop: asyncio.AbstractEventLoop | None = None
        self._thread: threading.Thread | None = None
        self._process = 0
        # Held while work is scheduled on the loop, so that none goes to a loop that has ended.
        self._handing = threading.Lock()
        self._endings = Endings()

    # Entering and leaving.

    def open(self) -> Self:
        """Wait for the daemon, as ``with`` does. For notebooks, which must call :meth:`close`.

        Raises:
            NoDaemon: No daemon answers there in time; the message includes a remedy.
            BusError: The endpoint, the namespace or the file cannot be used.
        """
        loop = asyncio.new_event_loop()
        self._loop = loop
        self._process = os.getpid()
        self._thread = threading.Thread(target=self._run, args=(loop,), daemon=True)
        self._thread.start()
        # Also stop the robot if the program ends without closing it.
        atexit.register(self.close)
        try:
            self._wait(self._robot.__aenter__())
        except BaseException:
            self.close()
            raise
        return self

    def close(self) -> None:
        """Stop the robot and end the session; safe to call twice, and from a callback.

        Calls that wait for the robot in other threads end in a ``BusError``.
        """
        thread, loop = self._thread, self._loop
        # After a fork, the session and its thread are the parent's.
        if thread is None or loop is None or os.getpid() != self._process:
            return
        closing = self._hand(self._robot.close())
        if closing is None or threading.current_thread() is thread:
            return
        impatience: BaseException | None = None
        while not closing.done():
            try:
                concurrent.futures.wait([closing])
            except (KeyboardInterrupt, SystemExit) as error:
                # Ctrl-C again: still stop the robot, which takes a bounded time.
                impatience = error
        with self._handing:
            first, self._thread = self._thread is not None, None
            if first:
                loop.call_soon_threadsafe(loop.stop)
        thread.join()
        atexit.unregister(self.close)
        if not closing.cancelled():
            closing.result()
        if impatience is not None:
            raise impatience

    def __enter__(self) -> Self:
        self._endings.begin_plain()
        try:
            return self.open()
        except BaseException:
            self._endings.end()
            raise

    def __exit__(self, _kind: object, error: BaseException | None, *_: object) -> None:
        if isinstance(error, KeyboardInterrupt):
            shorten(error)
        try:
            self.close()
        finally:
            self._endings.end()

    def _run(self, loop: asyncio.AbstractEventLoop) -> None:
        asyncio.set_event_loop(loop)
        try:
            warned = False
            while self._thread is not None:
                try:
                    loop.run_forever()
                except (SystemExit, KeyboardInterrupt) as error:
                    if not warned:
                        warned = True
                        name = type(error).__name__
                        log.warning("A callback raised %s: the robot is stopped.", name)
                    self.close()
            # Threads that wait for the robot go on.
            waiting = asyncio.all_tasks(loop)
            for task in waiting:
                task.cancel()
            loop.run_until_complete(asyncio.gather(*waiting, return_exceptions=True))
        finally:
            loop.close()

    # The loop's thread.

    def _hand(self, work: Coroutine[Any, Any, Result]) -> concurrent.futures.Future[Result] | None:
        """Start a coroutine in the loop's thread; None unless that thread runs."""
        with self._handing:
            if self._loop is not None and self._thread is not None:
                return asyncio.run_coroutine_threadsafe(work, self._loop)
        work.close()
        return None

    def _wait(self, work: Coroutine[Any, Any, Result]) -> Result:
        """Run a coroutine in the loop's thread; its result."""
        if self._thread is not None and os.getpid() != self._process:
            work.close()
            raise BusError(
                "The robot was opened by the process that this one was forked from.",
                remedy="Open one in this process.",
            )
        if self._thread is not None and threading.current_thread() is self._thread:
            work.close()
            raise RuntimeError("A callback of the robot's may not wait for the robot.")
        future = self._hand(work)
        if future is None:
            raise BusError(
                "The robot is not open.", remedy="Use it in `with Robot(...) as robot:`."
            )
        try:
            return future.result()
        except concurrent.futures.CancelledError:
            raise BusError(
                "The robot was closed while this call waited.",
                remedy="End the threads that use it before leaving the `with` block.",
            ) from None
        except BaseException:
            # Ctrl-C: the program no longer waits for it.
            future.cancel()
            raise

    def _now(self, call: Callable[[], Result]) -> Result:
        """Call something in the loop's thread, at once; its result."""
        if self._thread is not None and threading.current_thread() is self._thread:
            return call()

        async def work() -> Result:
            return call()

        return self._wait(work())

    # Presence.

    @property
    def alive(self) -> bool:
        """Whether the daemon is there now."""
        return self._robot.alive

    @property
    def problem(self) -> str:
        """The reason why no daemon is there, in a sentence; empty while one is."""
        return self._robot.problem

    @property
    def counters(self) -> Counters:
        """The fate of this program's commands, counted."""
        return self._robot.counters

    @property
    def commanded(self) -> Twist2d | None:
        """The velocity that is published now, zeros included; None while nothing is."""
        return self._robot.commanded

    wait_alive = _waiting(AsyncRobot.wait_alive)

    # Driving.

    drive = _at_once(AsyncRobot.drive)
    stop = _at_once(AsyncRobot.stop)
    finished = _waiting(AsyncRobot.finished)
    standing = _waiting(AsyncRobot.standing)

    # Moves.

    straight = _waiting(AsyncRobot.straight)
    turn = _waiting(AsyncRobot.turn)
    arc = _waiting(AsyncRobot.arc)
    go_to = _waiting(AsyncRobot.go_to)
    follow = _waiting(AsyncRobot.follow)

    def moves(self, *moves: Move, uncertain_m: float | None = None) -> PlainMoveRun:
        """Moves in a row: ``with robot.moves(Move(kind="turn", angle_rad=1.57)) as run:``.

        In the block, ``for progress in run:`` follows them to their end, and ``run.finished()``
        waits for the goal. Leaving the block ends them. Arguments as for ``AsyncRobot.moves``.
        """
        made = self._now(lambda: self._robot.moves(*moves, uncertain_m=uncertain_m))
        return PlainMoveRun(made, self._wait)

    # Samples.

    def newest(self, message: type[Message], *, wait_s: float = 1.5) -> Message | None:
        """The newest sample, such as ``robot.newest(PoseSample)``.

        The first call subscribes, and asks the daemon for the newest one there.

        Returns:
            None if there is none yet, or no daemon.
        """
        sample = self._now(lambda: self._robot.newest(message))
        if sample is None and self.alive:
            try:
                return self.get(message, timeout_s=wait_s)
            except NoDaemon:
                return None
        return sample

    def samples(
        self, message: type[Message], *, depth: int | None = None, timeout_s: float = math.inf
    ) -> Iterator[Message]:
        """Samples as they come: ``for pose in robot.samples(PoseSample):``.

        A slower loop gets the newest one; ``depth`` samples are queued if it is given, and 64
        events. The iterator survives restarts of the daemon. It ends when the robot is left, or
        when no sample came for ``timeout_s`` seconds.
        """
        stream = self._now(lambda: self._robot.samples(message, depth=depth))
        return self._iterate(stream, timeout_s)

    def _iterate(self, stream: Samples[Message], timeout_s: float) -> Iterator[Message]:
        async def following() -> Message | None:
            async with timeout(None if timeout_s == math.inf else timeout_s):
                return await anext(stream, None)

        try:
            while (sample := self._wait(following())) is not None:
                yield sample
        except (TimeoutError, BusError):
            return
        finally:
            with suppress(BusError):
                self._now(stream.close)

    def on(
        self,
        message: type[Message],
        callback: Callable[[Message], object],
        *,
        depth: int | None = None,
    ) -> Callable[[], None]:
        """Call back when samples come, in the thread that repeats commands.

        Args:
            message: The kind, such as ``EventSample``.
            callback: Has to return soon. It may drive and stop, but not wait for the robot.
            depth: Samples queued for a slow callback, as for :meth:`samples`.

        Returns:
            A function that ends it.
        """
        end = self._now(lambda: self._robot.on(message, callback, depth=depth))
        return lambda: self._now(end)

    get = _waiting(AsyncRobot.get)

    # Services.

    request = _waiting(AsyncRobot.request)
    estop = _waiting(AsyncRobot.estop)
    release = _waiting(AsyncRobot.release)
    reset_odometry = _waiting(AsyncRobot.reset_odometry)
    set_pose = _waiting(AsyncRobot.set_pose)
    config = _waiting(AsyncRobot.config)
    board = _waiting(AsyncRobot.board)


class PlainMoveRun:
    """Moves in a row: ``with robot.moves(...) as run:``, made by ``Robot.moves``.

    Entering asks for them; leaving ends them, if they are not over. ``for progress in run:``
    follows them to their end.

    Args:
        run: The same for asyncio.
        wait: Waits for a coroutine in the thread of the robot.
    """

    def __init__(self, run: MoveRun, wait: Callable[[Coroutine[Any, Any, Any]], Any]) -> None:
        self._run = run
        self._wait = wait

    def __enter__(self) -> Self:
        self._wait(self._run.start())
        return self

    def __exit__(self, *_: object) -> None:
        # A robot that was closed meanwhile has ended them.
        with suppress(BusError):
            self._wait(self._run.end())

    def __iter__(self) -> Iterator[MoveSample]:
        async def following() -> MoveSample | None:
            return await anext(self._run, None)

        while (sample := self._wait(following())) is not None:
            yield sample

    def finished(self) -> MoveSample:
        """Wait for the goal; raises as ``MoveRun.finished`` does."""
        sample: MoveSample = self._wait(self._run.finished())
        return sample

    def pause(self) -> None:
        """Make the robot stop on its way."""
        self._wait(self._run.pause())

    def resume(self) -> None:
        """Continue paused moves."""
        self._wait(self._run.resume())

    def end(self) -> None:
        """End the moves, if they are not over: the robot stops."""
        self._wait(self._run.end())
