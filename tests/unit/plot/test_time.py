"""Pictures of models side by side."""

from __future__ import annotations

import math

import numpy as np

from rotorid.plot.time import Curve, Score, predictions, score_dots

TIME = np.linspace(0.0, 1.0, 50)
MEASURED = Curve(TIME, np.sin(TIME))
MODEL = Curve(TIME, 0.9 * np.sin(TIME))


def test_every_model_has_a_row_and_every_kind_of_score_a_color() -> None:
    figure = score_dots(
        ["a", "b", "c"],
        {
            "own": [Score(80.0), Score(81.0), Score(math.nan)],
            "unseen": [Score(70.0, 2.0), Score(71.0), Score(72.0, 1.0)],
        },
    )
    own, unseen = figure["data"]
    assert own["x"] == [80.0, 81.0, None]
    assert unseen["error_x"]["array"] == [2.0, None, 1.0]
    assert own["marker"]["color"] != unseen["marker"]["color"]
    axis = figure["layout"]["yaxis"]
    assert axis["ticktext"] == ["a", "b", "c"]
    # The first model stands on top.
    assert axis["range"][0] > axis["range"][1]
    np.testing.assert_allclose(np.subtract(unseen["y"], own["y"]), unseen["y"][0] - own["y"][0])


def test_a_kind_without_numbers_is_left_out_and_the_others_keep_their_colors() -> None:
    none = [Score(math.nan), Score(math.nan)]
    kinds = {"own": none, "unseen": [Score(70.0), Score(71.0)]}
    (alone,) = score_dots(["a", "b"], kinds)["data"]
    both = score_dots(["a", "b"], {**kinds, "own": [Score(1.0), Score(2.0)]})["data"]
    assert alone["name"] == "unseen"
    assert alone["y"] == [0.0, 1.0]
    assert alone["marker"] == both[1]["marker"]


def test_labels_stay_text() -> None:
    figure = score_dots(["<a href='x'>"], {"own": [Score(1.0)]})
    assert figure["layout"]["yaxis"]["ticktext"] == ["&lt;a href='x'&gt;"]


def test_every_output_has_a_panel_with_the_models_that_predict_it() -> None:
    figure = predictions(
        ["phi", "theta"],
        {"phi": MEASURED, "theta": MEASURED},
        {"whole": {"phi": MODEL, "theta": MODEL}, "pitch": {"theta": MODEL}},
    )
    drawn = [(trace["yaxis"], trace["name"]) for trace in figure["data"]]
    assert drawn == [("y", "measured"), ("y", "whole"), ("y2", "measured"), ("y2", "whole"), ("y2", "pitch")]
    # Each name stands in the legend once, also that of a model which comes in a later panel.
    assert [trace["name"] for trace in figure["data"] if trace["showlegend"]] == ["measured", "whole", "pitch"]
    assert figure["layout"]["annotations"][0]["text"] == "roll angle phi [°]"


def test_models_differ_in_color_and_dash() -> None:
    models = {str(number): {"phi": MODEL} for number in range(4)}
    lines = [(t["line"]["color"], t["line"]["dash"]) for t in predictions(["phi"], {"phi": MEASURED}, models)["data"]]
    assert len(set(lines)) == 5
