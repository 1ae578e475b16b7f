"""Tasks whose questions are answered together."""

import pytest
import torch

from regional_lv.inference.in_step import run_in_step


def adder(rounds):
    """A task that asks `rounds` times and adds up random numbers and answers."""

    def task(ask):
        total = torch.zeros(())
        for i in range(rounds):
            total = total + torch.rand(()) + ask(i)
        return float(total)

    return task


def test_questions_are_answered_together():
    asked = []

    def answer(which, questions):
        asked.append((which, questions))
        return [10 * i for i in which]

    results = run_in_step([adder(1), adder(3), adder(2)], answer, [1, 2, 3])
    assert asked == [([0, 1, 2], [0, 0, 0]), ([1, 2], [1, 1]), ([1], [2])]
    for result, number, rounds in zip(results, (0, 10, 20), (1, 3, 2), strict=True):
        assert 0 < result - number * rounds < rounds


def test_random_numbers_do_not_depend_on_the_others():
    def answer(which, questions):
        torch.rand(7)
        return [0] * len(which)

    torch.manual_seed(5)
    together = run_in_step([adder(2), adder(4)], answer, [1, 2])
    (alone,) = run_in_step([adder(4)], answer, [2])
    assert together[1] == alone and together[0] != alone
    torch.manual_seed(2)
    assert alone == pytest.approx(float(sum(torch.rand(()) for _ in range(4))))


def test_tasks_that_never_ask():
    results = run_in_step([lambda ask: 1, lambda ask: None], lambda *_: [], [1, 2])
    assert results == [1, None]


@pytest.mark.parametrize("where", ["task", "answer"])
def test_an_error_ends_all_tasks(where):
    ended = []

    def task(ask):
        try:
            ask(0)
            if where == "task":
                raise ValueError("bad")
            ask(1)
        finally:
            ended.append(True)

    def answer(which, questions):
        if where == "answer":
            raise ValueError("bad")
        return [0] * len(which)

    with pytest.raises(ValueError, match="bad"):
        run_in_step([task] * 3, answer, [1, 2, 3])
    assert len(ended) == 3
