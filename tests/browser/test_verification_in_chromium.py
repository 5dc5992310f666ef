"""The page of ``verify`` in a real browser: pictures in nested details are drawn when they open, and fit."""

from __future__ import annotations

import html as markup
import json
import re
from pathlib import Path

from tests.browser.chromium import dump
from tests.unit.report.sample import HOSTILE
from tests.unit.report.verification_sample import verified

from rotorid.report.frame import policy
from rotorid.report.verification import render_checks

PROBE = """
document.documentElement.dataset.probe = "waiting";
setTimeout(async () => {
  for (const details of document.querySelectorAll("details")) details.open = true;
  await new Promise((done) => setTimeout(done, 2500));
  const seen = (place) => [
    place.dataset.picture, Boolean(place.data) && Math.abs(place.clientWidth - place._fullLayout.width) < 2,
  ];
  document.documentElement.dataset.probe = JSON.stringify(
    Object.fromEntries(Array.from(document.querySelectorAll("[data-picture]"), seen)),
  );
}, 1500);
"""


def test_all_pictures_are_drawn_in_their_width(chromium: str, tmp_path: Path) -> None:
    html = render_checks(*verified(), title="t")
    digest = r"sha256-[A-Za-z0-9+/=]+"
    (added,) = re.findall(digest, policy(PROBE))
    *_, last = re.findall(digest, html.partition("</head>")[0])
    html = html.replace(last, f"{last}&#39; &#39;{added}", 1)
    html = html.replace("</body>", f"<script>{PROBE}</script></body>", 1)
    shown, said = dump(chromium, html, tmp_path)
    (found,) = re.findall(r'data-probe="([^"]*)"', shown)
    drawn = json.loads(markup.unescape(found))
    assert drawn == dict.fromkeys(("check-0", "check-0-ahead", "check-0-loop", "sweeps-0-0"), True)
    assert said == []


def test_a_hostile_log_cannot_act(chromium: str, tmp_path: Path) -> None:
    _, said = dump(chromium, render_checks(*verified(record=HOSTILE), title=HOSTILE), tmp_path)
    assert said == []
