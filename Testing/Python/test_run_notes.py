"""What ``la-flatten run`` says where gaps cannot be looked for as usual."""

import pytest

from LAFlatteningLib.cli import run
from LAFlatteningLib.errors import SurfaceError
from LAFlatteningLib.gaps import find_gaps

TOO_NARROW = "The area round RSPV runs into RIPV."


def refusing(*refused):
    """`find_gaps` that refuses some search areas, as it does in a narrow atrium."""

    def find(*arguments, search):
        if search in refused:
            raise SurfaceError(TOO_NARROW)
        return find_gaps(*arguments, search=search)

    return find


def test_what_the_search_notes_is_told(phantom_map):
    gaps, notes = run.search_gaps(phantom_map, "LGE", 120.0)
    assert notes == list(find_gaps(phantom_map, "LGE", (120.0,)).notes) == list(gaps.notes)
    assert not any("not looked for" in note for note in notes)
    assert gaps.search == "within 15 mm of the rims"


def test_other_search_areas_are_told_in_words(phantom_map, monkeypatch):
    monkeypatch.setattr(run, "find_gaps", refusing(run.SEARCH_MM))
    gaps, notes = run.search_gaps(phantom_map, "LGE", 120.0)
    assert gaps.search == run.BY_TEMPLATE
    assert gaps.notes == tuple(notes)
    assert notes[0] == f"Gaps were not looked for within 15 mm of the veins: {TOO_NARROW}"
    assert "drawn round the veins on the template instead" in notes[1]


def test_it_is_told_why_there_are_no_gaps(phantom_map, monkeypatch):
    monkeypatch.setattr(run, "find_gaps", refusing(run.SEARCH_MM, run.BY_TEMPLATE))
    gaps, notes = run.search_gaps(phantom_map, "LGE", 120.0)
    assert gaps is None
    assert [TOO_NARROW in note for note in notes] == [True, True]


@pytest.mark.parametrize("search", [15.0, "vein_surroundings"])
def test_both_searches_are_of_the_library(phantom_map, search):
    assert find_gaps(phantom_map, "LGE", (120.0,), search=search).rings
