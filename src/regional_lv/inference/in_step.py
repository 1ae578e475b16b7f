"""Tasks that go on in step: each stops where it needs a value, and all values are made at once.

Pyro's sampler asks for one gradient at a time, and an exact Gaussian process with 5,500 simulations
takes as long over one as over a few: most of it goes into reading the Cholesky factor. A task is
any code that asks. It runs in a thread of its own, but only one thread runs at a time, in an order
that is always the same. Each task has its own state of PyTorch's random numbers: what it draws does
not depend on the others.
"""

import threading
from collections.abc import Callable, Sequence
from typing import Any

import torch

Ask = Callable[[Any], Any]
"""What a task calls with a question; it returns with the answer."""


def run_in_step(
    tasks: Sequence[Callable[[Ask], Any]],
    answer: Callable[[list[int], list[Any]], Sequence[Any]],
    seeds: Sequence[int],
) -> list[Any]:
    """Results of all tasks.

    answer: gets the numbers of the tasks that wait and their questions, returns an answer for each.
    seeds: of the random numbers of each task. An error in a task or in `answer` ends all of them.
    """
    lanes = [_Lane(task, seed) for task, seed in zip(tasks, seeds, strict=True)]
    try:
        while True:
            for lane in lanes:
                lane.advance()
            waiting = [i for i, lane in enumerate(lanes) if not lane.done]
            if not waiting:
                return [lane.result for lane in lanes]
            answers = answer(waiting, [lanes[i].question for i in waiting])
            for i, one in zip(waiting, answers, strict=True):
                lanes[i].answer = one
    finally:
        for lane in lanes:
            lane.stop()


class _Stopped(BaseException):
    """Unwinds a task that nobody will answer any more."""


class _Lane:
    """A task, its thread and its random numbers; runs only between `advance` and a question."""

    def __init__(self, task: Callable[[Ask], Any], seed: int):
        self.question = self.answer = self.result = self._error = None
        self.done = self._stopping = False
        self._random = torch.Generator().manual_seed(seed).get_state()
        self._go, self._back = threading.Semaphore(0), threading.Semaphore(0)
        self._thread = threading.Thread(target=self._run, args=(task,), daemon=True)
        self._thread.start()

    def advance(self) -> None:
        """Let the task run to its next question or to its end; raise what it raises."""
        if self.done:
            return
        outer = torch.get_rng_state()
        torch.set_rng_state(self._random)
        self._go.release()
        self._back.acquire()
        self._random = torch.get_rng_state()
        torch.set_rng_state(outer)
        if self._error is not None:
            raise self._error

    def stop(self) -> None:
        """End the thread, whatever it waits for."""
        self._stopping = True
        self._go.release()
        self._thread.join()

    def _ask(self, question: Any) -> Any:
        self.question = question
        self._back.release()
        self._wait()
        return self.answer

    def _wait(self) -> None:
        self._go.acquire()
        if self._stopping:
            raise _Stopped

    def _run(self, task: Callable[[Ask], Any]) -> None:
        try:
            self._wait()
            self.result = task(self._ask)
        except _Stopped:
            return
        except BaseException as error:
            self._error = error
        self.done = True
        self._back.release()
