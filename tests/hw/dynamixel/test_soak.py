"""The driver in damaged replies; with ``--thorough`` fifty thousand cycles."""

from tests.support.soak import soak


def test_every_damaged_reply_is_counted_as_what_it_was_and_none_is_believed(
    thorough: bool, wholly: bool
) -> None:
    found = soak(50_000 if thorough else 4_000 if wholly else 1_500, seed=2)
    assert found.problems == []
    assert found.damaged > 0
    assert found.fastest > 5.0, "a shaft that stands still proves nothing"
