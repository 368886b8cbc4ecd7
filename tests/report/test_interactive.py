"""Figures of matplotlib as figures of a page: every artist arrives, as few numbers as it takes, none of them wrong."""

import gzip
import json
import re
from base64 import b64decode

import numpy as np
import pytest
from matplotlib.figure import Figure

from optid.report.interactive import interactive, library, specification
from optid.report.vertices import numbers, thin


@pytest.fixture
def panels():
    return Figure(figsize=(9, 4), layout="constrained").subplots(1, 2)


def traces(axes):
    figure = axes.get_figure(root=True)
    figure.draw_without_rendering()
    return specification(figure, "name")


def test_a_line_keeps_values_name_style_and_axis(panels):
    axes = panels[1]
    axes.plot(
        [0, 1, 2],
        [1e-3, np.nan, 3e-3],
        "--",
        color="#2b2f36",
        lw=1.5,
        label="measured",
        drawstyle="steps-post",
    )
    axes.legend()
    axes.set_xlabel("time (s)")
    drawn = traces(axes)
    line = next(trace for trace in drawn["data"] if trace.get("name") == "measured")
    assert (line["x"], line["y"]) == ([0.0, 1.0, 2.0], [1e-3, None, 3e-3])
    assert (
        line["line"]["shape"] == "hv"
        and line["line"]["color"] == "rgba(43,47,54,1)"
        and "dash" in line["line"]
    )
    assert (line["xaxis"], line["legend"], line["showlegend"]) == ("x2", "legend2", True)
    assert drawn["layout"]["xaxis2"]["title"]["text"] == "time (s)"


def test_bands_spans_dots_bars_and_stairs_arrive(panels):
    axes = panels[0]
    axes.axhspan(-1, 1, color="red", alpha=0.2, label="noise")
    axes.axvline(3.0, color="blue")
    axes.vlines([1, 2], 0, [4, 5])
    axes.scatter([1, 2], [7, 8], s=9)
    axes.fill_between([0, 1], [0, 0], [1, 2], alpha=0.3)
    axes.stairs([1, 2], [0, 1, 2], fill=True)
    axes.barh(["a"], [4.0])
    drawn = traces(axes)
    band, line = drawn["layout"]["shapes"]
    assert (band["y0"], band["y1"], band["xref"], band["yref"]) == (-1, 1, "x domain", "y")
    assert (line["x0"], line["x1"], line["xref"], line["yref"]) == (3.0, 3.0, "x", "y domain")
    every = [trace for trace in drawn["data"] if trace["xaxis"] == "x"]
    assert any(trace["x"] == [1.0, 1.0, None, 2.0, 2.0, None] and trace["y"][1] == 4.0 for trace in every)
    assert any(trace.get("mode") == "markers" and trace["y"] == [7.0, 8.0] for trace in every)
    assert any(trace.get("fill") == "toself" and 2.0 in trace["y"] for trace in every)
    assert any(trace.get("fill") == "tozeroy" and trace["y"] == [1.0, 2.0, 2.0] for trace in every)
    assert any(trace.get("fill") == "toself" and max(trace["x"]) == 4.0 for trace in every)


def test_a_mesh_is_a_picture_with_values_under_the_pointer_and_zooms_on_log_axes(panels):
    axes = panels[0]
    axes.set_xscale("log")
    axes.pcolormesh([1.0, 10.0, 100.0], [0.0, 1.0], [[5.0, 6.0]])
    drawn = traces(axes)
    (image,) = drawn["layout"]["images"]
    assert (image["x"], image["sizex"], image["y"], image["sizey"]) == (0.0, 2.0, 1.0, 1.0)
    assert image["source"].startswith("data:image/png;base64,")
    assert next(trace for trace in drawn["data"] if "text" in trace)["text"] == ["5", "6"]
    assert drawn["layout"]["xaxis"]["type"] == "log"


def test_stated_labels_stand_at_their_ticks(panels):
    axes = panels[0]
    axes.plot([0, 1], [0, 1])
    axes.set_xticks([0, 1], ["2026-10-01", "2026-10-02"])
    shown = traces(axes)["layout"]["xaxis"]
    assert (shown["tickvals"], shown["ticktext"]) == ([0.0, 1.0], ["2026-10-01", "2026-10-02"])


def test_shared_axes_zoom_together():
    top, bottom = Figure().subplots(2, 1, sharex=True)
    top.plot([0, 1], [0, 1])
    drawn = traces(bottom)
    assert drawn["layout"]["xaxis2"]["matches"] == "x"
    assert "matches" not in drawn["layout"]["yaxis2"]
    assert drawn["layout"]["xaxis"]["showticklabels"] is False


def test_thinning_loses_no_spike():
    y = np.zeros(100_000)
    y[54_321] = 7.0
    x = np.arange(100_000.0)
    few_x, few_y = thin(x, y)
    assert len(few_y) <= 3100 and few_y.max() == 7.0 and few_x[few_y.argmax()] == 54_321
    assert thin(x[:50], y[:50])[0] is not None and len(thin(x[:50], y[:50])[0]) == 50


def test_numbers_are_as_long_as_a_page_shows():
    assert numbers([0.0, 1.0, 1 / 3]) == [0.0, 1.0, 0.3333]
    assert numbers([1e-6, 3e-6 + 1e-13]) == [1e-6, 3e-6]
    assert numbers([-1e-9, 1.0])[0] == 0.0 and str(numbers([-1e-9, 1.0])[0]) == "0.0"
    assert numbers([np.nan, np.inf, 5.0]) == [None, None, 5.0]
    assert numbers([]) == []


def test_a_figure_is_data_that_a_page_holds(panels):
    panels[0].plot([0, 1], [0, 1], label="</script>")
    figure = panels[0].get_figure(root=True)
    html = interactive(figure, "name")
    packed = re.fullmatch(
        r'<div class="figure" style="height:400px"><script type="application/gzip">([\w+/=]+)</script></div>',
        html,
    )
    content = json.loads(gzip.decompress(b64decode(packed[1])))
    assert content["name"] == "name" and len(content["data"]) == 2


def test_the_library_is_the_vendors_with_its_licence():
    from optid.report.interactive import HERE

    folder = HERE / "plotly"
    assert (
        "MIT" in (folder / "LICENSE").read_text()
        and "plotly.js-basic-dist-min" in (folder / "README.md").read_text()
    )
    packed = re.search(r'id="plotly">([\w+/=]+)</script>', library())
    assert gzip.decompress(b64decode(packed[1])).decode() == (folder / "plotly-basic.min.js").read_text(
        encoding="utf-8"
    )
    assert len(library()) < 600_000
