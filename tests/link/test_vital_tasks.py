"""Tasks end together, and what must be finished is."""

from __future__ import annotations

import asyncio

import pytest

from yahboomd.core.errors import BoardSilent, PortLost
from yahboomd.core.link.vital_tasks import VitalTasks, undisturbed
from yahboomd.simulation.virtual_time import on_virtual_time


async def idle() -> None:
    await asyncio.sleep(60.0)


async def failing(error: Exception) -> None:
    await asyncio.sleep(1.0)
    raise error


@on_virtual_time
async def test_the_end_of_the_body_ends_the_tasks() -> None:
    tasks = VitalTasks()
    async with tasks.running():
        tasks.start(idle(), "idle")
        tasks.start(tasks.failure(), "watch")
    assert asyncio.all_tasks() == {asyncio.current_task()}


@pytest.mark.parametrize("name", ["watch", "idle"])
@on_virtual_time
async def test_a_task_that_ends_or_is_cancelled_alone_ends_all(name: str) -> None:
    tasks = VitalTasks()

    async def body() -> None:
        async with tasks.running():
            tasks.start(idle(), "idle")
            tasks.start(tasks.failure(), "watch")
            await asyncio.sleep(1.0)
            next(each for each in asyncio.all_tasks() if each.get_name() == name).cancel()
            await tasks.failure()

    with pytest.raises(RuntimeError, match=f"the task {name} ended by itself"):
        await body()


@pytest.mark.parametrize(
    ("errors", "raised"),
    [
        ((PortLost("gone"), BoardSilent("silent")), PortLost),
        ((BoardSilent("silent"), ZeroDivisionError()), ZeroDivisionError),
    ],
)
@on_virtual_time
async def test_a_mistake_of_the_program_or_the_first_error_is_raised_alone(
    errors: tuple[Exception, ...], raised: type[Exception]
) -> None:
    tasks = VitalTasks()

    async def body() -> None:
        async with tasks.running():
            for error in errors:
                tasks.start(failing(error), "failing")
            await idle()

    with pytest.raises(raised):
        await body()


@on_virtual_time
async def test_an_error_of_the_body_and_its_cancellation_are_raised_as_they_are() -> None:
    async def body() -> None:
        tasks = VitalTasks()
        async with tasks.running():
            tasks.start(idle(), "idle")
            raise KeyError

    with pytest.raises(KeyError):
        await body()
    with pytest.raises(TimeoutError):
        async with asyncio.timeout(1.0), VitalTasks().running():
            await idle()


@on_virtual_time
async def test_work_is_finished_however_often_its_caller_is_cancelled() -> None:
    done = False

    async def work() -> None:
        nonlocal done
        await asyncio.sleep(1.0)
        done = True

    task = asyncio.create_task(undisturbed(work()))
    while not task.done():
        await asyncio.sleep(0.1)
        task.cancel()
    assert done
    assert task.cancelled()
