"""Times the live page in a headless Chromium: to the first curve, and from a sample to a pixel."""

from __future__ import annotations

import time
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from scripts.chromium import Tab

PATIENCE_S = 40.0
EVERY = 8
"""Of so many pictures, one is followed to the compositor"""
HOOK = (
    """(() => {
const seen = window.seen = { frames: [], shown: [], curve: 0, rows: false };
const Socket = window.WebSocket;
window.WebSocket = class extends Socket {
  constructor(address) {
    super(address);
    this.addEventListener("message", ({ data }) => { seen.rows ||= typeof data !== "string"; });
  }
};
new PerformanceObserver((list) => {
  for (const each of list.getEntries()) seen.shown.push([+each.identifier, each.renderTime]);
}).observe({ type: "element" });
const request = window.requestAnimationFrame.bind(window);
let last = "", mark = null;
window.requestAnimationFrame = (draw) => request((now) => {
  const rows = seen.rows;
  draw(now);
  const to = document.getElementById("panels")?.dataset.to ?? "";
  if (!rows || to === last) return;
  last = to;
  const at = performance.now();
  seen.curve ||= at;
  seen.frames.push([+to, at]);
  if (seen.frames.length % """
    + str(EVERY)
    + """) return;
  mark?.remove();
  mark = document.createElement("span");
  mark.setAttribute("elementtiming", String(seen.frames.length - 1));
  mark.style.cssText = "position:fixed;left:4px;top:4px;font:12px monospace";
  mark.textContent = String(seen.frames.length);
  document.body.append(mark);
});
})();"""
)
"""Added to the page: the time of each picture with new rows, and of some when they are shown"""


@dataclass(frozen=True, slots=True)
class Opening:
    """How a page opened; times from the navigation [s]."""

    bytes: int
    """Transferred, with the headers"""
    paint_s: float
    """Until the browser drew anything of the page"""
    curve_s: float
    """Until rows of the run were drawn"""
    opened_s: float
    """When the navigation began, on the machine's monotonic clock [s]"""


def prepare(tab: Tab) -> None:
    """Add the clock to every page that the tab opens."""
    tab.call("Page.addScriptToEvaluateOnNewDocument", source=HOOK)
    tab.look(1280, 860)


def opening(tab: Tab, address: str) -> Opening:
    """Open a live page, and time it until its first curve."""
    tab.call("Page.navigate", url=address)
    tab.wait("window.seen?.curve", PATIENCE_S)
    found = tab.value(
        "({ curve: seen.curve, zero: performance.now(),"
        " paint: performance.getEntriesByName('first-contentful-paint')[0]?.startTime,"
        " bytes: [...performance.getEntriesByType('navigation'),"
        " ...performance.getEntriesByType('resource')].reduce((s, e) => s + e.transferSize, 0) })"
    )
    paint = found["paint"] or found["curve"]
    return Opening(found["bytes"], 1e-3 * paint, 1e-3 * found["curve"], clock_of(tab))


def clock_of(tab: Tab) -> float:
    """Return the zero of the page's clock on the machine's monotonic one [s], within 1 ms or so."""
    found = []
    for _ in range(20):
        before = time.monotonic()
        page_s = 1e-3 * tab.value("performance.now()")
        after = time.monotonic()
        found.append((after - before, 0.5 * (before + after) - page_s))
    zero_s: float = min(found)[1]
    return zero_s


def close(tab: Tab) -> None:
    """Leave the page, before its server ends."""
    tab.open("about:blank")


@dataclass(frozen=True, slots=True)
class Pictures:
    """Pictures of a page that follows a run."""

    newest_s: NDArray[np.float64]
    """Time of the newest row in each, from the start of the run [s], shape (n,)"""
    drawn_s: NDArray[np.float64]
    """When each was drawn, monotonic clock [s]"""
    shown_s: NDArray[np.float64]
    """When the compositor had it; NaN: not followed"""


def pictures(tab: Tab, seconds: float) -> Pictures:
    """Follow the newest second of a run for a time; the page must be open."""
    tab.value("document.querySelector('#spans button[value=\"1\"]').click()")
    time.sleep(2.0)
    begin = tab.value("seen.frames.length")
    time.sleep(seconds)
    zero_s = clock_of(tab)
    frames = np.array(tab.value(f"seen.frames.slice({begin})"), dtype=float)
    shown = np.full(len(frames), np.nan)
    for index, at in tab.value("seen.shown"):
        if at > 0.0 and 0 <= index - begin < len(frames):
            shown[index - begin] = zero_s + 1e-3 * at
    return Pictures(frames[:, 0], zero_s + 1e-3 * frames[:, 1], shown)


def ages_ms(newest_s: NDArray[np.float64], at_s: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the age of every row in the first picture that shows it [ms].

    Args:
        newest_s: Time of the newest row in each picture [s], shape (n,).
        at_s: When each picture was drawn, or shown, on the same clock [s]; NaN leaves it out.
    """
    found = [
        1e3 * (at - newest) + np.arange(round(1e3 * (newest - before)))
        for before, newest, at in zip(newest_s[:-1], newest_s[1:], at_s[1:], strict=True)
        if np.isfinite(at)
    ]
    return np.concatenate(found) if found else np.array([])
