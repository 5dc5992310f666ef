"""Whether a mixer has four ways to move a vehicle."""

from __future__ import annotations

import numpy as np
import pytest

from rotorid.errors import ModelError
from rotorid.models.rotors import check_mixer, layout_names, library_layout

PLUS = np.array([[1.0, 1.0, 1.0, 1.0], [0.0, -1.0, 0.0, 1.0], [1.0, 0.0, -1.0, 0.0], [1.0, -1.0, 1.0, -1.0]])


def test_layouts_of_the_library_are_not_singular() -> None:
    for name in layout_names():
        layout = library_layout(name)
        singular = bool(check_mixer(layout.effectiveness(0.05)[2:]))
        assert singular == bool(layout.uncontrollable), name


def test_size_does_not_matter() -> None:
    assert check_mixer(np.array([[1.0], [1e-3], [1e3], [1e-6]]) * PLUS) == []


@pytest.mark.parametrize(
    ("rows", "said"),
    [
        ([PLUS[0], PLUS[1], PLUS[2], PLUS[2] - 2.0 * PLUS[1]], "rank 3: U4 = -2 U2 + 1 U3"),
        ([PLUS[0], PLUS[1], PLUS[2], np.zeros(4)], "rank 3: U4 = 0"),
        ([PLUS[0], PLUS[0], PLUS[2], PLUS[3]], "rank 3: U2 = 1 U1"),
        ([np.zeros(4), PLUS[1], PLUS[2], PLUS[3]], "rank 3: U1 = 0"),
    ],
)
def test_it_says_which_moment_is_no_freedom_of_its_own(rows: list[np.ndarray], said: str) -> None:
    (finding,) = check_mixer(np.array(rows))
    assert said in finding.message
    assert finding.numbers == {"rank": 3.0}


def test_other_rows_are_refused() -> None:
    with pytest.raises(ModelError, match="thrust, roll, pitch, yaw"):
        check_mixer(np.eye(3))
