"""Pages opened in a headless Chromium: what is seen, what moves with what, and that nothing fails.

Run by ``pytest -m browser``; screenshots are kept in build/pages.
"""

import io
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).parent))

from report_browser import Browser, find_chromium

pytestmark = pytest.mark.browser
ROOT = Path(__file__).resolve().parents[2]
PICTURES = ROOT / "build" / "pages"
COMPASS = str(ROOT / "examples" / "01_compass.nc")
Cli = Callable[..., Any]


@pytest.fixture
def browser() -> Iterator[Browser]:
    chromium = find_chromium()
    if chromium is None:
        pytest.skip("no Chromium on this computer (apt-get install chromium, or set CHROMIUM to its path)")
    with Browser(chromium) as found:
        yield found


@pytest.fixture
def preview(tmp_path: Path, cli: Cli) -> Path:
    page = tmp_path / "preview.html"
    assert cli("preview", COMPASS, "-o", str(page)).status == 0
    return page


def pixels(png: bytes) -> np.ndarray:
    from matplotlib.image import imread

    return np.rint(imread(io.BytesIO(png), format="png")[..., :3] * 255).astype(int)


PLACES = """(() => {
  const g = groupstart, s = g.scene, p = g.path, box = s.canvas.getBoundingClientRect(), out = [];
  const hidden = (x, y) => document.elementFromPoint(x, y) !== s.canvas;
  for (let k = 0; k < s.feedIndex.length; k++) {
    const i = s.feedIndex[k], at = p.xyz.map((c) => (c[i] + c[i + 1]) / 2);
    const v = s.low.clone().set(...at).project(s.camera);
    const x = box.x + (v.x + 1) / 2 * box.width, y = box.y + (1 - v.y) / 2 * box.height;
    const ends = [i, i + 1].map((j) => {
      const w = s.low.clone().set(...p.xyz.map((c) => c[j])).project(s.camera);
      return [w.x * box.width / 2, w.y * box.height / 2];
    });
    if (Math.hypot(ends[0][0] - ends[1][0], ends[0][1] - ends[1][1]) < 3 || hidden(x, y)) continue;
    const c = s.colour.slice(6 * k, 6 * k + 6);
    out.push([x, y, 127.5 * (c[0] + c[3]), 127.5 * (c[1] + c[4]), 127.5 * (c[2] + c[5])]);
  }
  return out.filter((place, k) => k % Math.max(1, Math.floor(out.length / 300)) === 0);
})()"""


def share_in_colour(browser: Browser, picture: Path) -> float:
    """Share of the places on the path that have the path's colour in the picture."""
    browser.settle()
    places = browser.run(PLACES)
    image = pixels(browser.picture(picture))
    assert len(places) > 50
    hits = 0
    for x, y, *colour in places:
        near = image[int(y) - 2 : int(y) + 3, int(x) - 2 : int(x) + 3].reshape(-1, 3)
        hits += bool(np.abs(near - np.array(colour)).max(axis=1).min() < 40)
    return hits / len(places)


def test_the_preview_shows_the_path_in_its_colours(browser: Browser, preview: Path) -> None:
    browser.open(preview)
    browser.run("groupstart.scene.look('top')")
    for mode in ("speed", "feed", "ratio", "accel", "cause", "age"):
        browser.run(f"groupstart.legend.set('{mode}')")
        assert share_in_colour(browser, PICTURES / f"preview-{mode}.png") > 0.9
    assert browser.faults == []


def test_the_time_moves_tool_line_plots_and_numbers(browser: Browser, preview: Path) -> None:
    browser.open(preview)
    before = browser.run("window.__state.tool")
    browser.run(
        "(() => { const t = document.querySelector('#time'); t.value = 30; t.dispatchEvent(new Event('input')); })()"
    )
    state = browser.run("window.__state")
    assert state["time_s"] == pytest.approx(30, abs=0.1)
    assert state["tool"] != before
    plan = browser.run(
        "(() => { const p = groupstart.path, i = window.__state.stretch; return [p.t[i], p.t[i + 1], p.line[i]]; })()"
    )
    assert plan[0] <= state["time_s"] <= plan[1]
    assert browser.wait(f"document.querySelector('.row.now')?.dataset.line === '{state['line']}'")
    assert f"X{state['tool'][0]:10.3f}" in browser.run("document.querySelector('#readout').textContent")
    left = browser.run("parseFloat(document.querySelector('.cursor-line').style.left)")
    width = browser.run("groupstart.plots.shown[0].u.over.clientWidth")
    assert left / width == pytest.approx(30 / 59.69, abs=0.01)
    assert browser.faults == []


def test_a_click_on_a_line_goes_to_its_time_and_play_goes_on(browser: Browser, preview: Path) -> None:
    browser.open(preview)
    browser.run("document.querySelector('#program-scroll').scrollTop = 110 * 18")
    browser.wait("document.querySelector('.row[data-line=\"123\"]')")
    browser.settle()
    browser.click_on('.row[data-line="123"]')
    at = browser.run("window.__state.time_s")
    assert browser.run("window.__state.line") == 123
    assert at > 15
    browser.run("groupstart.rate = 100")
    browser.click_on("#play")
    browser.wait(f"window.__state.time_s > {at} + 2")
    browser.wait("!groupstart.playing")
    assert browser.run("window.__state.time_s") == pytest.approx(59.69, abs=0.02)
    assert browser.faults == []


def test_a_click_on_the_path_goes_there(browser: Browser, preview: Path) -> None:
    browser.open(preview)
    browser.run("groupstart.scene.look('top')")
    browser.settle()
    places = browser.run(PLACES)
    x, y, *_ = places[len(places) // 2]
    browser.click(x, y)
    tool = browser.run("window.__state.tool")
    spot = browser.run(
        "(() => { const s = groupstart.scene, b = s.canvas.getBoundingClientRect(), "
        "v = s.tool.position.clone().project(s.camera); "
        "return [b.x + (v.x + 1) / 2 * b.width, b.y + (1 - v.y) / 2 * b.height]; })()"
    )
    assert spot == pytest.approx([x, y], abs=4)
    assert tool != [0, 0, 0]


def test_lost_steps_stand_out_in_map_list_and_verdict(browser: Browser, tmp_path: Path, cli: Cli) -> None:
    page = tmp_path / "report.html"
    answer = cli("verify", COMPASS, "--lose-steps", "X:-4@60", "--report", str(page))
    assert answer.status == 1
    assert "in line 60" in answer.out
    browser.open(page)
    assert browser.run("window.__state.verdict") == "NO-GO"
    assert "line 60" in browser.run("document.querySelector('#verdict').textContent")
    assert "line 60" in browser.run("document.querySelector('#shifts').textContent")
    split = browser.run(
        "(() => { const p = groupstart.path, t0 = groupstart.first[60], e = [[], []]; "
        "for (let i = 0; i < p.error.length; i++) if (p.kind[i] === 0) e[+(p.t[i] > t0)].push(p.error[i]); "
        "return e.map((a) => [Math.max(...a), a.sort((x, y) => x - y)[a.length >> 1]]); })()"
    )
    (most_before, middle_before), (most_after, middle_after) = split
    assert most_before < 14
    assert most_after > 18
    assert middle_after > 2 * middle_before
    browser.run("groupstart.scene.look('top')")
    assert share_in_colour(browser, PICTURES / "report-slip.png") > 0.85
    line = int(browser.run("document.querySelector('#worst [data-worst] td').textContent"))
    assert line >= 60
    browser.click_on("#worst [data-worst='0']")
    assert browser.run("window.__state.line") == line
    assert browser.wait(f"document.querySelector('.row.now')?.dataset.line === '{line}'")
    assert browser.run("document.querySelector('#worst [data-worst=\"0\"]').classList.contains('now')")
    browser.picture(PICTURES / "report-worst-place.png")
    assert browser.faults == []


def test_every_tab_of_a_mixed_machine_opens_in_both_themes(browser: Browser, tmp_path: Path, cli: Cli) -> None:
    page = tmp_path / "report.html"
    assert cli("verify", COMPASS, "-m", "mill3-mixed", "--report", str(page)).status == 0
    browser.open(page)
    lags = browser.run("[...document.querySelectorAll('.lags')].map((d) => [...d.querySelectorAll('tr')].length)")
    assert lags == [3 + 2 + 8, 3 + 2 + 8]  # axes, heads and the latest lines, of commands and of shafts
    assert "lag of the shafts by axis and line" in browser.run("document.querySelectorAll('.lags')[1].textContent")
    tabs = browser.run("[...document.querySelectorAll('#tabs button')].map((b) => b.dataset.tab)")
    assert tabs == ["motion", "error", "rates", "servo", "bus", "cut"]
    for theme in ("dark", "light"):
        for tab in tabs:
            browser.click_on(f"#tabs [data-tab={tab}]")
            assert browser.run("document.querySelectorAll('#lower-body canvas').length") > 0
            browser.settle()
            browser.picture(PICTURES / f"report-{theme}-{tab}.png")
        browser.click_on("#theme")
    browser.run("groupstart.tab('bus'); groupstart.plots.zoom(20, 20.4)")
    browser.picture(PICTURES / "report-bus-near.png")
    browser.run("groupstart.scene.layers.sim = true; groupstart.scene.setSim(groupstart.sim, 200)")
    browser.picture(PICTURES / "report-exaggerated.png")
    assert browser.faults == []


def test_a_long_program_comes_in_two_steps_without_long_tasks(browser: Browser, tmp_path: Path, cli: Cli) -> None:
    rows = []
    for r in range(60):
        xs = np.linspace(0, 100, 2000)[:: 1 if r % 2 == 0 else -1]
        rows += [f"G1 X{x:.3f} Y{r * 0.5:.3f} Z{-2 + 1.5 * np.sin(x * 2.3 + r):.3f}" for x in xs]
    program = tmp_path / "long.nc"
    program.write_text("G21 G90 G64 P0.01 F1800\nG0 Z5\n" + "\n".join(rows) + "\nG0 Z5\nM2\n")
    page = tmp_path / "long.html"
    assert cli("preview", str(program), "-o", str(page)).status == 0
    assert page.stat().st_size < 12e6
    browser.open(page)
    assert browser.run("window.__state.first_picture_ms") < 10_000
    browser.run(
        "window.__long = []; new PerformanceObserver((list) => window.__long.push(...list.getEntries()"
        ".map((e) => e.duration))).observe({ type: 'longtask' }); 0"
    )
    for script in ("groupstart.setTime(500)", "groupstart.legend.set('cause')", "groupstart.plots.zoom(100, 140)",
                   "groupstart.toLine(77777)", "groupstart.legend.set('accel')"):  # fmt: skip
        browser.run(script)
        browser.settle()
    assert browser.run("window.__state.line") == 77777
    assert browser.wait("document.querySelector('.row.now')?.dataset.line === '77777'")
    assert max([0.0, *browser.run("window.__long")]) < 200
    assert browser.faults == []
