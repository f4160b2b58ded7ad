#!/usr/bin/env python3
"""Opens a report in Chromium and looks for what a reader would stumble over.

    scripts/check_report.py REPORT.html [--widths PX...] [--shots DIR] [--wait S]
    scripts/check_report.py --which         # only says which browser it would take

At three widths, or those given, light and dark: errors on the console, anything that would be
fetched, figures that are not drawn, their titles and numbers cut off or one on the other, contents
wider than the screen; then the report as it is printed. Prints what it measured as JSON. Exit 0
nothing found; 1 something was; 2 no such report, no browser, or one that fails or falls silent.
"""

from __future__ import annotations

import argparse
import base64
import json
import os
import re
import select
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from contextlib import suppress
from itertools import chain
from pathlib import Path
from typing import Any

BROWSERS = (
    "chromium", "chromium-browser", "google-chrome", "google-chrome-stable",
    "chromium-headless-shell",
)  # fmt: skip
WIDTHS, SCHEMES = (390, 820, 1400), ("light", "dark")
NARROW, HEIGHT = 600, 900
#: Width of what is printed on a page of paper, px.
PAPER = 710
#: How long the browser may say nothing, and how long it may take to end.
WAIT_S, END_S = 60.0, 10.0
#: Waits until what was asked for is drawn, and what it called has run. A browser without a screen
#: may stop making frames.
FRAME = """
  const next = () => Promise.race([
    new Promise(done => requestAnimationFrame(done)),
    new Promise(done => setTimeout(done, 500)),
  ]);
  const frame = async () => { await next(); await next(); };
"""
#: Scrolls through the page, frame by frame, so that every figure is drawn; once more where a busy
#: browser left frames out.
SCROLL = (
    f"(async () => {{{FRAME}"
    + """
  document.querySelectorAll('details').forEach(d => { d.open = true; });
  const left = () => [...document.querySelectorAll('.canvas')].some(
    c => !c.querySelector('.main-svg'));
  for (let pass = 0; pass < 3 && (pass === 0 || left()); pass++) {
    for (let y = 0; y < document.documentElement.scrollHeight; y += 700) {
      scrollTo({top: y, behavior: 'instant'});
      await frame();
    }
  }
  scrollTo({top: 0, behavior: 'instant'});
  await frame();
})()"""
)
MEASURE = """(() => {
  const width = document.documentElement.clientWidth;
  const wide = [];
  for (const e of document.body.querySelectorAll('*')) {
    // Wide tables scroll, but where their rows are stacked there is nothing to scroll to.
    const table = e.closest('.scroll');
    if (table && !(table.matches('.stack') && width < 640) || e.closest('svg')) continue;
    const box = e.getBoundingClientRect();
    if (box.width > 0 && box.right > width + 1) {
      wide.push(e.tagName + ' ' + e.className + ' ' + e.textContent.slice(0, 40));
    }
  }
  const canvases = [...document.querySelectorAll('.canvas')];
  const cut = [];
  for (const canvas of canvases) {
    const paper = canvas.getBoundingClientRect();
    for (const text of canvas.querySelectorAll('svg text')) {
      const box = text.getBoundingClientRect();
      const out = [paper.left - box.left, box.right - paper.right, paper.top - box.top,
        box.bottom - paper.bottom];
      // A line's box has room above and below its letters, and a pixel is a matter of rounding.
      if (box.width > 0 && Math.max(...out) > 1) {
        cut.push(`'${text.textContent.slice(0, 60)}' of '${canvas.ariaLabel}' by`
          + ` ${Math.ceil(Math.max(...out))} px`);
      }
    }
  }
  // Two numbers or titles of axes that lie on one another.
  const ROOM = 0, touching = [];
  const labels = '[class$="tick"] text, text[class$="title"]';
  for (const canvas of canvases) {
    const texts = [...canvas.querySelectorAll(labels)]
      .map(text => [text.textContent.slice(0, 40), text.getBoundingClientRect()])
      .filter(([, box]) => box.width > 0);
    const first = texts.flatMap(([name, a], k) => texts.slice(k + 1)
      .filter(([, b]) => Math.min(a.right, b.right) - Math.max(a.left, b.left) > ROOM
        && Math.min(a.bottom, b.bottom) - Math.max(a.top, b.top) > ROOM)
      .map(([other]) => `'${name}' on '${other}' of '${canvas.ariaLabel}'`))[0];
    if (first) touching.push(first);
  }
  return {
    cut: cut.slice(0, 5),
    touching: touching.slice(0, 5),
    scrolling: [...document.querySelectorAll('.scroll')].filter(
      s => s.scrollWidth > s.clientWidth + 1).map(s => s.querySelector('th')?.innerText.trim()),
    hint: document.querySelector('.hint')?.innerText.trim(),
    overflow: document.documentElement.scrollWidth - width,
    wide: wide.slice(0, 5),
    figures: canvases.length,
    drawn: canvases.filter(c => c.querySelector('.main-svg')).length,
    height: document.documentElement.scrollHeight,
    paper: getComputedStyle(document.body).backgroundColor,
    load_ms: Math.round(performance.getEntriesByType('navigation')[0].loadEventEnd),
  };
})()"""


class Browser:
    """A headless Chromium, spoken to over a pipe in its DevTools protocol."""

    def __init__(self, path: str, profile: str, wait_s: float = WAIT_S) -> None:
        self._wait_s = wait_s
        to_browser, self._out = os.pipe()
        self._in, from_browser = os.pipe()

        def as_expected() -> None:
            # The browser reads descriptor 3 and writes 4; neither may be overwritten on the way.
            ends = os.dup(to_browser), os.dup(from_browser)
            high = [os.dup2(end, 20 + k) for k, end in enumerate(ends)]
            os.dup2(high[0], 3)
            os.dup2(high[1], 4)

        self._process = subprocess.Popen(
            [path, "--headless=new", "--remote-debugging-pipe", "--no-sandbox", "--disable-gpu",
             "--no-first-run", "--hide-scrollbars", f"--user-data-dir={profile}"],
            close_fds=False, preexec_fn=as_expected, start_new_session=True,
            stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
        )  # fmt: skip
        os.close(to_browser)
        os.close(from_browser)
        self._count, self._rest = 0, b""
        self.events: list[dict[str, Any]] = []
        self.session: str | None = None

    def start(self) -> None:
        """Open an empty page."""
        target = self.call("Target.createTarget", url="about:blank")["targetId"]
        self.session = self.call("Target.attachToTarget", targetId=target, flatten=True)[
            "sessionId"
        ]
        for domain in ("Page", "Runtime", "Log", "Network"):
            self.call(f"{domain}.enable")

    def call(self, method: str, **parameters: Any) -> dict[str, Any]:
        """The result of a command; what happens meanwhile is kept in `events`."""
        self._count += 1
        message: dict[str, Any] = {"id": self._count, "method": method, "params": parameters}
        if self.session is not None:
            message["sessionId"] = self.session
        os.write(self._out, json.dumps(message).encode() + b"\0")
        while True:
            answer = self._receive()
            if answer.get("id") == self._count:
                if "error" in answer:
                    raise RuntimeError(f"{method}: {answer['error'].get('message')}")
                result: dict[str, Any] = answer["result"]
                return result
            self.events.append(answer)

    def evaluate(self, script: str) -> Any:
        """The value of a script, once it is there."""
        found = self.call(
            "Runtime.evaluate", expression=script, awaitPromise=True, returnByValue=True
        )
        if "exceptionDetails" in found:
            raise RuntimeError(f"script failed: {found['exceptionDetails']}")
        return found["result"].get("value")

    def until(self, method: str) -> None:
        """Wait for an event."""
        end = time.monotonic() + self._wait_s
        while not any(e.get("method") == method for e in self.events):
            if time.monotonic() > end:
                raise RuntimeError(f"no {method} within {self._wait_s:g} s")
            self.events.append(self._receive())

    def _receive(self) -> dict[str, Any]:
        while b"\0" not in self._rest:
            if not select.select([self._in], [], [], self._wait_s)[0]:
                raise RuntimeError(f"the browser says nothing for {self._wait_s:g} s")
            more = os.read(self._in, 1 << 20)
            if not more:
                raise RuntimeError("the browser is gone")
            self._rest += more
        first, self._rest = self._rest.split(b"\0", 1)
        answer: dict[str, Any] = json.loads(first)
        return answer

    def close(self) -> None:
        """End the browser."""
        self.session = None
        with suppress(BrokenPipeError):
            os.write(self._out, json.dumps({"id": 0, "method": "Browser.close"}).encode() + b"\0")
        try:
            self._process.wait(min(END_S, self._wait_s))
        except subprocess.TimeoutExpired:
            # Some are started by a script that waits for them: all of the group.
            os.killpg(self._process.pid, signal.SIGKILL)
            self._process.wait()
        os.close(self._out)
        os.close(self._in)


def complaints(events: list[dict[str, Any]]) -> list[str]:
    """Errors of scripts and of the console, and addresses that were asked for."""
    found = []
    for event in events:
        method, data = event.get("method"), event.get("params", {})
        if method == "Runtime.exceptionThrown":
            details = data["exceptionDetails"]
            found.append("exception: " + str(details.get("exception", details))[:300])
        elif method == "Runtime.consoleAPICalled" and data["type"] in ("error", "warning"):
            found.append(f"console: {data['args']}"[:300])
        elif method == "Log.entryAdded" and data["entry"]["level"] in ("error", "warning"):
            found.append(f"log: {data['entry']['text']}"[:300])
        elif method == "Network.requestWillBeSent":
            url = data["request"]["url"]
            if not url.startswith(("file:", "data:", "blob:")):
                found.append(f"asks for {url}"[:300])
    return found


def look(browser: Browser, report: Path, width: int, shots: Path | None) -> list[Any]:
    """Open the report at a width, in every colour scheme one after the other."""
    # First away from the page before: it would draw all its figures for the new width and scheme.
    _open(browser, "about:blank")
    browser.call(
        "Emulation.setDeviceMetricsOverride",
        width=width, height=HEIGHT, deviceScaleFactor=1, mobile=width < NARROW,
    )  # fmt: skip
    browser.call("Emulation.setTouchEmulationEnabled", enabled=width < NARROW)
    _choose(browser, SCHEMES[0])
    _open(browser, report.absolute().as_uri())
    browser.evaluate(SCROLL)
    views = []
    for scheme in SCHEMES:
        _choose(browser, scheme)
        browser.evaluate(f"(async () => {{{FRAME}await frame();}})()")
        measured = browser.evaluate(MEASURE)
        found = complaints(browser.events)
        browser.events.clear()
        if measured["overflow"] > 0 or measured["wide"]:
            found.append(f"wider than the screen: {measured['overflow']} px, {measured['wide']}")
        if measured["cut"]:
            found.append(f"cut off: {', '.join(measured['cut'])}")
        found += _touching(measured)
        if measured["drawn"] != measured["figures"]:
            found.append(f"{measured['drawn']} of {measured['figures']} figures drawn")
        if shots is not None:
            _shoot(browser, shots / f"{report.stem}-{width}-{scheme}", width, measured["height"])
        views.append({"width": width, "scheme": scheme, **measured, "found": found})
    return views


def _touching(measured: dict[str, Any]) -> list[str]:
    texts: list[str] = measured["touching"]
    return [f"one on the other: {', '.join(texts)}"] if texts else []


def _open(browser: Browser, url: str) -> None:
    browser.events.clear()
    browser.call("Page.navigate", url=url)
    browser.until("Page.loadEventFired")


def _choose(browser: Browser, scheme: str) -> None:
    features = [{"name": "prefers-color-scheme", "value": scheme}]
    browser.call("Emulation.setEmulatedMedia", features=features)


def _shoot(browser: Browser, stem: Path, width: int, height: int) -> None:
    part = 2400
    for k, top in enumerate(range(0, height, part)):
        clip = {"x": 0, "y": top, "width": width, "height": min(part, height - top), "scale": 1}
        shot = browser.call("Page.captureScreenshot", clip=clip, captureBeyondViewport=True)
        stem.with_name(f"{stem.name}-{k:02d}.png").write_bytes(base64.b64decode(shot["data"]))


def printed(browser: Browser, report: Path, shots: Path | None) -> Any:
    """The report on paper."""
    browser.events.clear()
    found = _touching(_on_paper(browser))
    pdf = base64.b64decode(browser.call("Page.printToPDF", printBackground=True)["data"])
    if shots is not None:
        (shots / f"{report.stem}.pdf").write_bytes(pdf)
    pages = len(re.findall(rb"/Type\s*/Page\b", pdf))
    return {"printed_bytes": len(pdf), "pages": pages, "found": found + complaints(browser.events)}


def _on_paper(browser: Browser) -> dict[str, Any]:
    """What is measured of the page as it is laid out for printing."""
    paper = {"width": PAPER, "height": HEIGHT, "deviceScaleFactor": 1, "mobile": False}
    browser.call("Emulation.setDeviceMetricsOverride", **paper)
    browser.call("Emulation.setEmulatedMedia", media="print")
    wait = f"(async () => {{{FRAME}await frame();}})()"
    browser.evaluate("dispatchEvent(new Event('beforeprint'))")
    browser.evaluate(wait)
    measured: dict[str, Any] = browser.evaluate(MEASURE)
    browser.evaluate("dispatchEvent(new Event('afterprint'))")
    browser.call("Emulation.setEmulatedMedia", media="")
    browser.evaluate(wait)
    return measured


def views_of(path: str, options: argparse.Namespace) -> list[Any]:
    """What a browser at `path` makes of the report, view by view."""
    report, shots = options.report, options.shots
    with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as profile:
        browser = Browser(path, profile, options.wait)
        try:
            browser.start()
            looks = [look(browser, report, width, shots) for width in options.widths]
            return [*chain.from_iterable(looks), printed(browser, report, shots)]
        finally:
            browser.close()


def installed() -> str | None:
    """The path of the first browser that is there."""
    return next((found for name in BROWSERS if (found := shutil.which(name))), None)


def main() -> int:
    """Entry point."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n", maxsplit=1)[0])
    what = parser.add_mutually_exclusive_group(required=True)
    what.add_argument("report", type=Path, nargs="?", help="report.html")
    what.add_argument("--which", action="store_true", help="print the browser's path, open none")
    parser.add_argument(
        "--widths", type=int, nargs="+", default=WIDTHS, metavar="PX",
        help="widths of the window (default 390 820 1400)",
    )  # fmt: skip
    parser.add_argument("--shots", type=Path, metavar="DIR", help="folder for screenshots")
    parser.add_argument(
        "--wait", type=float, default=WAIT_S, metavar="S",
        help="how long the browser may say nothing (default %(default)g)",
    )  # fmt: skip
    options = parser.parse_args()
    path = installed()
    if path is None:
        print(f"no browser: none of {', '.join(BROWSERS)} is installed", file=sys.stderr)
        return 2
    if options.which:
        print(path)
        return 0
    if not options.report.is_file():
        print(f"{options.report}: no such file", file=sys.stderr)
        return 2
    if options.shots is not None:
        options.shots.mkdir(parents=True, exist_ok=True)
    try:
        views = views_of(path, options)
    except (RuntimeError, OSError) as error:
        print(f"{options.report}: could not be looked at: {error}", file=sys.stderr)
        return 2
    size = options.report.stat().st_size
    print(json.dumps({"report": str(options.report), "bytes": size, "views": views}, indent=1))
    return 1 if any(view["found"] for view in views) else 0


if __name__ == "__main__":
    sys.exit(main())
