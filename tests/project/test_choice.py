"""Choice of the test cases that run after each change, and of their number of ranks."""

import itertools
import pathlib

import choice
import pytest


def product(**lists):
    return [
        dict(zip(lists, c, strict=True)) for c in itertools.product(*map(range, lists.values()))
    ]


def values(cases, *names):
    return {tuple(case[name] for name in names) for case in cases}


@pytest.mark.parametrize("sizes", ((4, 3, 2), (2, 5, 3, 2)))
def test_pairs_of_three_lists_and_more(sizes):
    cases = product(**dict(zip("abcd", sizes, strict=False)))
    kept = [cases[i] for i in choice.chosen(cases)]
    assert len(kept) < 0.7 * len(cases)
    for pair in itertools.combinations(cases[0], 2):
        assert values(kept, *pair) == values(cases, *pair)


def test_values_of_two_lists():
    """Names that are parametrized together in one list are not combined with each other."""
    cases = [case | {"with_a": case["a"]} for case in product(a=4, b=3)]
    kept = [cases[i] for i in choice.chosen(cases)]
    assert len(kept) == 4
    assert all(values(kept, name) == values(cases, name) for name in ("a", "b"))


def test_one_list_is_whole():
    for cases in ([{}], product(a=5)):
        assert list(choice.chosen(cases)) == list(range(len(cases)))


def test_every_test_has_a_number_of_ranks(request):
    """Each test has a number of ranks that a run exists for.

    Tests that need several ranks get several.
    """
    for item in request.session.items:
        ranks = choice.ranks_of(item)
        assert ranks in (1, 2, 3)
        assert ranks > 1 or not item.get_closest_marker("several_ranks")
        assert ranks == 1 or pathlib.Path(item.path).parent.name not in choice.ALONE


def test_slow_tests_are_there():
    """Each line of the list is the name of a test, or a prefix of names of cases."""
    folder = pathlib.Path(choice.__file__).parent
    for name in choice.SLOW:
        path, _, test = name.partition("::")
        text = (folder / path).read_text()
        assert not test or f"def {test.partition('[')[0]}(" in text, name
