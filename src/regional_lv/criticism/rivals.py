"""Which sets of causes are simulated: the best one, and those that may be better once they are."""

from collections.abc import Collection, Iterable, Sequence

from regional_lv.criticism.verdict import LEAST_PROBABILITY, CauseSet, Member

WORTH_A_TRIAL = 30.0
"""Log posterior probability by which a set without one of the best set's causes may be behind and
still be simulated before others."""


def rivals(sets: Sequence[CauseSet]) -> list[CauseSet]:
    """What a round simulates, what matters most first.

    sets: the most probable one first, with what was simulated of them in the rounds before.
    """
    best, *others = sets
    # What single effects do to each other, or what an emulator misses of a large one, may pass for
    # one more cause, so that sets with fewer are simulated: the best one's own and the most
    # probable of each size. And no cause is named because the emulators have the sets without it
    # wrong. Those of these rivals that were not simulated come first, the nearest before the
    # others.
    by_members = {s.members: s for s in others}
    fewer = len(best.members) - 1
    smaller = [m for m in by_members if set(m) < set(best.members) and len(m) == fewer]
    wanted = {
        *smaller,
        *without_each(best.members, by_members),
        *of_each_size(m for m in by_members if len(m) <= fewer),
    }
    limit = best.log_posterior - WORTH_A_TRIAL
    unknown = [s for s in others if s.members in wanted and not s.confirmed]
    near = [s for s in unknown if s.log_posterior >= limit]
    likely = [s for s in others if s.probability >= LEAST_PROBABILITY]
    far = [s for s in unknown if s.members in smaller]
    order = {s.members: s for s in [best, *near, *likely, *far]}
    # Simulations that did not converge take long, and will hardly do so in another round.
    return sorted(order.values(), key=lambda s: s.failed)


def elsewhere(sets: Sequence[CauseSet]) -> list[CauseSet]:
    """What the last round simulates: sets whose simulations were far from their estimates, and that
    are probable or come before all that are confirmed. sets: the most probable one first."""
    first = next((i for i, s in enumerate(sets) if s.confirmed), len(sets))
    return [
        s
        for i, s in enumerate(sets)
        if s.elsewhere and (i < first or s.probability >= LEAST_PROBABILITY)
    ]


def without_each(
    whole: Sequence[Member], ranked: Collection[tuple[Member, ...]]
) -> list[tuple[Member, ...]]:
    """Of `ranked` sets, the first without each of the causes of `whole`."""
    found = []
    for name, _ in whole:
        first = next((members for members in ranked if name not in dict(members)), None)
        if first is not None:
            found.append(first)
    return found


def of_each_size(ranked: Iterable[tuple[Member, ...]]) -> list[tuple[Member, ...]]:
    """Of `ranked` sets, the first of each size."""
    found: dict[int, tuple[Member, ...]] = {}
    for members in ranked:
        found.setdefault(len(members), members)
    return list(found.values())
